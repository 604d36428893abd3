import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from slamcli.geometry import se2, se3
from slamcli.models import range_bearing
from slamcli.simulation.portable import PortableArray, portable

numbers = st.floats(-1e4, 1e4)


@given(st.lists(numbers, min_size=1, max_size=20))
def test_sine_and_cosine(values):
    x = np.array(values)
    # np's own are good to one unit in the last place; so is the reduction by multiples of pi/2 up to 1e4
    assert np.abs(np.asarray(np.sin(portable(x))) - np.sin(x)).max() <= 4e-16
    assert np.abs(np.asarray(np.cos(portable(x))) - np.cos(x)).max() <= 4e-16


@given(numbers, numbers)
def test_arc_tangent(y, x):
    assert float(np.arctan2(portable([y]), portable([x]))[0]) == pytest.approx(np.arctan2(y, x), rel=1e-15, abs=1e-320)


@pytest.mark.parametrize("y", [0.0, -0.0, 1.0, -1.0])
@pytest.mark.parametrize("x", [0.0, -0.0, 1.0, -1.0])
def test_arc_tangent_of_the_axes(y, x):
    mine, theirs = float(np.arctan2(portable([y]), portable([x]))[0]), float(np.arctan2(y, x))
    assert mine == pytest.approx(theirs, rel=3e-16) and np.signbit(mine) == np.signbit(theirs)


@pytest.mark.parametrize("function", [np.exp, np.tan, np.hypot, np.arcsin, np.log, np.matmul, np.vecdot])
def test_what_is_not_reproducible_is_refused(function):
    x = portable([[1.0, 2.0], [0.5, 0.25]])
    with pytest.raises(TypeError, match="every machine"):
        function(*[x] * function.nin)


def test_geometry_and_models_compute_with_it():
    rng = np.random.default_rng(1)
    a, b = rng.normal(size=(2, 50, 3))
    c, d = se3.normalize(rng.normal(size=(50, 7))), se3.normalize(rng.normal(size=(50, 7)))
    for function, x, y in ((se2.compose, a, b), (se2.between, a, b), (se3.compose, c, d), (se3.between, c, d)):
        assert np.allclose(function(portable(x), portable(y)), function(x, y), rtol=0, atol=1e-14)
    assert np.allclose(range_bearing.predict(portable(a), portable(b[:, :2])), range_bearing.predict(a, b[:, :2]))


def test_results_stay_portable():
    x = portable([0.25, 0.5])
    assert isinstance(np.sin(x) * 2.0 + x[::-1], PortableArray)
    assert isinstance(x[:1], PortableArray)
    out = np.empty(2)
    np.cos(x, out=out)
    assert out == pytest.approx(np.cos([0.25, 0.5]))
