"""Sweep files and the tasks they make: strict parsing, seeds that all methods share, keys that change with content."""

from __future__ import annotations

from pathlib import Path

import pytest
from sweeps import SMALL, sweep_of, tasks_in

from slamcli.batch.sweep.plan import INPUTS, command_levels, command_lines, injection_seed, tasks_of
from slamcli.batch.sweep.read import OWN
from slamcli.errors import InputError, UsageError

ROOT = Path(__file__).parents[2]


def test_tasks_are_the_product_of_axes_and_seeds(tmp_path):
    tasks = tasks_in(tmp_path)
    assert [task.name for task in tasks] == [
        "options.method=gn,seed=0",
        "options.method=gn,seed=1",
        "options.method=lm,seed=0",
        "options.method=lm,seed=1",
    ]
    assert [task.index for task in tasks] == [0, 1, 2, 3]
    assert len({task.key for task in tasks}) == 4


def test_command_lines_are_what_a_user_would_type(tmp_path):
    (first, *_) = tasks_in(tmp_path)
    simulate, optimize, evaluate = command_lines(first)
    assert " ".join(simulate).startswith("simulate square --poses 30 --set closures.count=4 --seed 0 -o graph.g2o")
    assert optimize[:4] == ("optimize", "graph.g2o", "--method", "gn")
    assert evaluate[:2] == ("evaluate", "estimate.g2o")


def test_all_methods_see_the_same_worlds_and_the_same_outliers(tmp_path):
    content = SMALL.replace("axes:", "  inject: {false-closures: 3}\naxes:").replace("seeds: 2", "seed: 7\nseeds: 2")
    seen: dict[int, set[tuple[str, ...]]] = {}
    for task in tasks_in(tmp_path, content):
        simulate, inject, *_ = command_lines(task)
        seen.setdefault(task.seed, set()).add(simulate + inject)
        assert simulate[simulate.index("--seed") + 1] == str(task.seed)
        assert inject[inject.index("--seed") + 1] == str(injection_seed(task.seed))
    assert sorted(seen) == [7, 8]
    assert all(len(lines) == 1 for lines in seen.values())


def test_injection_has_seeds_of_its_own():
    seeds = [injection_seed(seed) for seed in range(1000)]
    assert len(set(seeds)) == 1000
    assert all(0 <= found < 2**31 and found != seed for seed, found in enumerate(seeds))


def test_more_seeds_keep_the_keys(tmp_path):
    few = {task.name: task.key for task in tasks_in(tmp_path)}
    many = {task.name: task.key for task in tasks_in(tmp_path, SMALL.replace("seeds: 2", "seeds: 3"))}
    assert few.items() < many.items()


@pytest.mark.parametrize(
    ("old", "new"),
    [("poses: 30", "poses: 31"), ("[ate, chi2]", "[ate]"), ("simulate: square", "simulate: circle")],
)
def test_keys_change_with_what_a_result_depends_on(tmp_path, old, new):
    before = {task.key for task in tasks_in(tmp_path)}
    assert before.isdisjoint(task.key for task in tasks_in(tmp_path, SMALL.replace(old, new)))


def test_keys_depend_on_the_content_of_files_and_not_on_their_place(tmp_path):
    content = SMALL.replace("simulate: square", "simulate: world.yaml")
    keys = []
    for name, poses in (("a", 20), ("b", 20), ("c", 21)):
        folder = tmp_path / name
        folder.mkdir()
        (folder / "world.yaml").write_text(f"world: square\nrobot: {{noise: [0.0{poses}, 0.01]}}\n")
        keys.append([task.key for task in tasks_in(folder, content)])
    assert keys[0] != keys[2]
    # the path of the sweep's folder is in no key
    assert keys[0] == keys[1]


def test_the_keys_of_a_case_and_the_name_do_not_matter(tmp_path):
    keys = [task.key for task in tasks_in(tmp_path)]
    assert keys == [task.key for task in tasks_in(tmp_path, "name: other\n" + SMALL)]


def test_only_selects_by_name(tmp_path):
    sweep = sweep_of(tmp_path)
    found = tasks_of(sweep, "*method=lm*")
    assert [(task.index, task.name) for task in found] == [
        (2, "options.method=lm,seed=0"),  # numbered as in the whole sweep
        (3, "options.method=lm,seed=1"),
    ]
    with pytest.raises(UsageError, match="no task matches --only 'x'"):
        tasks_of(sweep, "x")


def test_an_axis_can_set_several_keys_and_take_one_away(tmp_path):
    axes = """\
axes:
  method:
    plain: {}
    tuned: {options.method: lm, options.max_iterations: 5, simulation.set.robot.noise: [0.1, 0.01]}
    none: {options.method: null}
"""
    content = SMALL[: SMALL.index("axes:")] + "  options: {method: gn}\n" + axes + "metrics: [chi2]\n"
    plain, _, tuned, _, none, _ = tasks_in(tmp_path, content)
    assert plain.case.options == {"method": "gn"}
    assert tuned.case.options == {"method": "lm", "max-iterations": 5}
    assert tuned.case.simulation["set"] == ["closures.count=4", "robot.noise=[0.1, 0.01]"]
    assert none.case.options == {}


def test_without_seeds_the_case_keeps_its_own(tmp_path):
    content = SMALL.replace("seeds: 2\n", "").replace("poses: 30", "poses: 30, seed: 5")
    tasks = tasks_in(tmp_path, content)
    assert [task.name for task in tasks] == ["options.method=gn", "options.method=lm"]
    assert {task.case.simulation["seed"] for task in tasks} == {5}


def test_small_numbers_stay_numbers(tmp_path):
    content = SMALL.replace("closures.count: 4", "robot.noise: [1.0e-7, 2]")
    assert tasks_in(tmp_path, content)[0].case.simulation["set"] == ["robot.noise=[1.0e-07, 2]"]


def test_files_are_called_as_the_sweep_file_calls_them(tmp_path):
    """Wherever they are: the table is the same on each machine."""
    (tmp_path / "graph.g2o").write_text("VERTEX_SE2 0 0 0 0\n")
    content = "case: {data: graph.g2o}\naxes: {data: [graph.g2o, sphere_small]}\nmetrics: [chi2]\n"
    first, second = tasks_in(tmp_path, content)
    assert (first.labels, first.case.data) == ({"data": "graph.g2o"}, str(tmp_path / "graph.g2o"))
    assert second.name == "data=sphere_small"
    assert second.case.data.endswith("sphere_small.g2o")


#: 10^400 tasks.
TOO_MANY = "".join(f"  options.a{k}: [{', '.join(map(str, range(10)))}]\n" for k in range(400))
DATA = SMALL.replace("simulate: square\n  simulation: {poses: 30, set: {closures.count: 4}}", "data: graph.g2o")


@pytest.mark.parametrize(
    ("content", "said"),
    [
        (SMALL + "axis: {}\n", ("unknown key 'axis'", "did you mean axes?")),
        (SMALL.replace("simulate:", "simulat:"), ("case: unknown key 'simulat'", "did you mean simulate?")),
        (SMALL.replace("square", "sqare"), ("no world and no file 'sqare'", "did you mean square?")),
        (SMALL.replace("[ate, chi2]", "[ate, chi3]"), ("no metric 'chi3'", "did you mean chi2?")),
        (SMALL.replace("[ate, chi2]", "[ate, ate]"), ("ate stands twice",)),
        (SMALL.replace("[ate, chi2]", "[seconds]"), ("changes from run to run", "--times")),
        (SMALL.replace("[ate, chi2]", "[memory]"), ("changes from run to run",)),
        (SMALL.replace("[ate, chi2]", "[exit_code]"), ("a column of the table anyway",)),
        (SMALL.replace("[ate, chi2]", "ate"), ("metrics: expected a list of names, found ate",)),
        (SMALL.replace("metrics: [ate, chi2]", ""), ("the key metrics is missing",)),
        (SMALL.replace("options.method", "option.method"), ("'option.method' is no key of the case",)),
        (SMALL.replace("options.method", "options.a.b"), ("options have no dots",)),
        (SMALL.replace("[gn, lm]", "[]"), ("axes.options.method: has no value",)),
        (SMALL.replace("[gn, lm]", "[1, 1.0]"), ("the value 1.0 stands twice",)),
        (SMALL.replace("[gn, lm]", "[1, true]"), ("the value true stands twice",)),
        (SMALL.replace("[gn, lm]", '[1, "1"]'), ("the value 1 stands twice",)),
        (SMALL.replace("[gn, lm]", '["g\\0n"]'), ("has a character that is none",)),
        (SMALL.replace("square", '"\\ud800"'), ("has a character that is none",)),
        (SMALL.replace("options.method: [gn, lm]", "ate: {a: {}}"), ("axes.ate: is the name of a metric, too",)),
        (
            SMALL.replace("chi2]", "'optimise:chi2']"),
            ("no step 'optimise'", "steps: simulate, inject, evaluate, optimize"),
        ),
        (SMALL.replace("options.method", "options.output"), ("the sweep sets --output itself",)),
        (SMALL.replace("poses: 30", "truth: t.g2o"), ("case.simulation.truth: the sweep sets --truth itself",)),
        (SMALL + "summary: {by: [options.method, options.method]}\n", ("options.method stands twice",)),
        (SMALL.replace("case:", "case:\n  time-limit: .inf"), ("at most 3e+08, found inf",)),
        (SMALL.replace("axes:", "axes:\n" + TOO_MANY), ("makes more than 10^15 tasks",)),
        (SMALL.replace("[gn, lm]", "[{a: 1}]"), ("expected a value or a list of values, found dict",)),
        (
            SMALL.replace("  options.method", "  m: {a: {options.method: gn}}\n  options.method"),
            ("as the axis m does",),
        ),
        (SMALL.replace("options.method: [gn, lm]", "task: {a: {}}"), ("is the name of a column",)),
        (SMALL.replace("seeds: 2", "seeds: 0"), ("seeds: expected a whole number of at least 1, found 0",)),
        (SMALL.replace("seeds: 2", "seed: 2"), ("seed: is the first of several seeds",)),
        (SMALL.replace("poses: 30", "seed: 3"), ("take simulation.seed out of the case",)),
        (SMALL.replace("case:", "case:\n  time-limit: 0"), ("expected a number of seconds, at most 3e+08, found 0",)),
        (SMALL.replace("case:", "case:\n  data: graph.g2o"), ("needs data or simulate, has both",)),
        (SMALL + "summary: {by: [methd]}\n", ("no axis 'methd'",)),
        (SMALL + "summary: {statistic: mode}\n", ("expected mean or median",)),
        (SMALL + "summary: {confidence: 95}\n", ("between 0 and 1",)),
        (SMALL.replace("seeds: 2", "seeds: 600000"), ("makes 1200000 tasks",)),
        (DATA, ("seeds: nothing in this case is random",)),
        (SMALL + "seeds: 3\n", ("is not valid YAML", "stands twice")),
        ("- a\n", ("expected keys with values",)),
        ("", ("the key case is missing",)),
    ],
)
def test_bad_files_are_told_by_name(tmp_path, content, said):
    (tmp_path / "graph.g2o").write_text("VERTEX_SE2 0 0 0 0\n")
    with pytest.raises(UsageError) as caught:
        tasks_in(tmp_path, content)
    text = "\n".join([caught.value.message, *caught.value.details])
    assert text.startswith(str(tmp_path / "study.yaml"))
    for part in said:
        assert part in text


@pytest.mark.parametrize(
    ("content", "line"),
    [
        (SMALL.replace("simulate:", "simulat:"), 3),
        (SMALL.replace("poses: 30", "poses: {}"), 4),
        (SMALL.replace("options.method", "option.method"), 6),
        (SMALL.replace("[ate, chi2]", "[ate, chi3]"), 7),
        (SMALL + "summary:\n  by: []\n  compare: {a: b}\n", 10),
        (SMALL.replace("options.method: [gn, lm]", "m:\n    a: {}\n    b: {method: gn}"), 8),
    ],
)
def test_messages_have_the_line(tmp_path, content, line):
    with pytest.raises(UsageError) as caught:
        tasks_in(tmp_path, content)
    assert caught.value.message.startswith(f"{tmp_path / 'study.yaml'}:{line}: ")


def test_a_file_of_the_current_folder_is_not_meant(tmp_path, monkeypatch):
    """Files are relative to the folder of the sweep file, wherever slamcli is called."""
    (tmp_path / "elsewhere").mkdir()
    monkeypatch.chdir(tmp_path / "elsewhere")
    Path("graph.g2o").write_text("VERTEX_SE2 0 0 0 0\n")
    content = DATA.replace("seeds: 2\n", "")
    with pytest.raises(InputError, match=r"study\.yaml:2: case\.data: .*graph\.g2o: there is no such file"):
        tasks_in(tmp_path, content)
    (tmp_path / "graph.g2o").write_text("VERTEX_SE2 0 0 0 0\n")
    assert {task.case.data for task in tasks_in(tmp_path, content)} == {str(tmp_path / "graph.g2o")}


def test_a_folder_of_a_log_is_data(tmp_path):
    (tmp_path / "log").mkdir()
    keys = []
    for content in ("1\n", "2\n"):
        (tmp_path / "log" / "a.txt").write_text(content)
        (task,) = tasks_in(tmp_path, "case: {command: ekf, data: log}\nmetrics: [nis]\n")
        assert task.case.data == str(tmp_path / "log")
        keys.append(task.key)
    assert len(set(keys)) == 2


def test_keys_depend_on_the_files_that_options_name(tmp_path):
    config = tmp_path / "options.yaml"
    content = SMALL.replace("axes:", f"  options: {{config: {config}}}\naxes:")
    keys = []
    for iterations in (1, 2):
        config.write_text(f"max-iterations: {iterations}\n")
        keys.append({task.key for task in tasks_in(tmp_path, content)})
    assert keys[0].isdisjoint(keys[1])


def test_inputs_are_the_options_that_name_files_to_be_read():
    """A file that is read and not among them could change, and old results would count."""
    import click

    from slamcli.cli.main import build_group

    group = build_group()
    context = click.Context(group, **group.context_settings)
    commands = {"simulation": ["simulate"], "inject": ["inject"], "evaluate": ["evaluate"]}
    commands["options"] = ["optimize", "ekf", "sparsity", "covariance", "info"]
    for section, names in commands.items():
        for name in names:
            for option in group.get_command(context, name).params:
                if isinstance(option, click.Option) and isinstance(option.type, click.Path):
                    writes = option.help.startswith(("Write", "Draw", "Picture"))
                    known = option.opts[-1].removeprefix("--") in (*INPUTS[section], *OWN[section])
                    assert writes or known, (name, option.opts)


def test_large_sweeps_are_planned_in_one_go(tmp_path):
    """A combination of levels is worked out once for all its seeds."""
    tasks = tasks_in(tmp_path, SMALL.replace("seeds: 2", "seeds: 2000"))
    assert len(tasks) == len({task.key for task in tasks}) == 4000
    assert len({id(task.labels) for task in tasks}) == 2 == len(list(command_levels(tasks)))


@pytest.mark.parametrize("name", ["nowhere.g2o", "world.yaml"])
def test_a_file_that_is_not_there(tmp_path, name):
    content = DATA.replace("graph.g2o", name) if name.endswith("g2o") else SMALL.replace("square", name)
    with pytest.raises(InputError, match=name):
        tasks_in(tmp_path, content.replace("seeds: 2\n", ""))


@pytest.mark.parametrize("path", sorted((ROOT / "configs" / "sweeps").glob("*.yaml")), ids=lambda path: path.stem)
def test_the_example_files(path):
    from slamcli.batch.sweep.read import read_sweep

    tasks = tasks_of(read_sweep(str(path)))
    assert len(tasks) == {"quick": 12, "robust-manhattan": 1000}[path.stem]
