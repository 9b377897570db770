"""Arguments of the wrong kind."""

import numpy as np
import pinocchio as pin


class Strange:
    """An object that is no number, whatever it is asked for."""

    def __array__(self, dtype=None, copy=None):
        raise RuntimeError("this cannot be an array")

    def __float__(self):
        raise RuntimeError("this cannot be a number")


HOSTILE = {
    "None": None,
    "a letter": "x",
    "no letter": "",
    "a digit": "1.0",
    "bytes": b"x",
    "complex": 1j,
    "complex128": np.complex128(1 + 2j),
    "complex64": np.complex64(1 + 2j),
    "huge": 10**400,
    "very huge": -(10**5000),
    "large": 2**70,
    "nan": float("nan"),
    "inf": float("inf"),
    "-inf": float("-inf"),
    "minus one": -1.0,
    "True": True,
    "numpy True": np.True_,
    "empty list": [],
    "empty array": np.empty((0, 3)),
    "object": object(),
    "strange": Strange(),
    "class": int,
    "function": len,
    "dict": {},
    "set": {1.0},
    "ragged": [[1.0], [1.0, 2.0]],
    "deep": np.ones((2, 3, 4)),
    "complex twist": np.full(6, 1j),
    "complex pose": np.eye(4) + 1j,
    "huge twist": [10**400] * 6,
    "nan twist": np.full(6, np.nan),
    "nan pose": np.full((4, 4), np.nan),
    "letters": ["1", "2", "3", "4", "5", "6"],
    "nothings": [None] * 6,
    "masked": np.ma.masked_array(np.arange(6.0), mask=[0, 0, 1, 0, 0, 0]),
    "masked pose": np.ma.masked_array(np.eye(4), mask=np.eye(4)),
    "three": np.arange(3.0),
    "seven": np.arange(7.0),
    "matrix": np.arange(36.0).reshape(6, 6),
    "scaled pose": 2.0 * np.eye(4),
    "scaled SE3": pin.SE3(2.0 * np.eye(3), np.zeros(3)),
    "nan SE3": pin.SE3(np.eye(3), np.full(3, np.nan)),
    "dates": np.array(["2020-01-01"] * 6, dtype="datetime64[D]"),
    "records": np.zeros(6, dtype=[("a", float)]),
}
