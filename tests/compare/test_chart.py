import itertools

import numpy as np
import pytest

from invariantqp.compare.chart import placed

ROOM = (0.0, 0.0, 400.0, 300.0)
RADIUS = 4.0


def overlap(a, b):
    return bool(np.all(a[:2] < b[2:]) and np.all(b[:2] < a[2:]))


@pytest.mark.parametrize(("n", "seed"), [(1, 0), (2, 0), (2, 1), (10, 0), (10, 1)])
def test_names_cover_neither_each_other_nor_a_point_and_stay_inside(n, seed):
    rng = np.random.default_rng(seed)
    points = np.column_stack((rng.uniform(100.0, 300.0, n), np.full(n, 100.0)))  # all as accurate, some as fast
    sizes = np.column_stack((rng.uniform(30.0, 130.0, n), np.full(n, 12.0)))
    names = placed(points, sizes, ROOM, RADIUS)
    np.testing.assert_allclose(names[:, 2:] - names[:, :2], sizes)
    for one, other in itertools.combinations(names, 2):
        assert not overlap(one, other)
    for name, (x, y) in itertools.product(names, points):
        assert not overlap(name, np.array([x - RADIUS, y - RADIUS, x + RADIUS, y + RADIUS]))
    assert (names[:, :2] >= ROOM[:2]).all()
    assert (names[:, 2:] <= ROOM[2:]).all()


def test_a_name_alone_is_beside_its_point_and_one_too_wide_no_crash():
    point, size = np.array([[200.0, 150.0]]), np.array([[80.0, 12.0]])
    (name,) = placed(point, size, ROOM, RADIUS)
    assert np.linalg.norm(np.clip(point[0], name[:2], name[2:]) - point[0]) <= 3.0 * RADIUS
    assert placed(point, 20.0 * size, ROOM, RADIUS).shape == (1, 4)
