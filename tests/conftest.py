"""How hypothesis runs in all tests.

pytest puts this folder on the path, so that every test can ``import support``. The folders of tests are no packages:
names of test files are unique.
"""

import hypothesis

# No deadline: the machine may be busy, and the first example imports. The same examples on every run.
hypothesis.settings.register_profile("slamcli", deadline=None, derandomize=True)
hypothesis.settings.load_profile("slamcli")
