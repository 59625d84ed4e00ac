"""Names of array types, for annotations: NumPy arrays of any shape, told apart by what their elements are."""

from typing import Any, TypeAlias

import numpy as np

Floats: TypeAlias = np.ndarray[Any, np.dtype[np.float64]]
Singles: TypeAlias = np.ndarray[Any, np.dtype[np.float32]]
Int64s: TypeAlias = np.ndarray[Any, np.dtype[np.int64]]
Int32s: TypeAlias = np.ndarray[Any, np.dtype[np.int32]]
Words: TypeAlias = np.ndarray[Any, np.dtype[np.uint32]]
Bytes: TypeAlias = np.ndarray[Any, np.dtype[np.uint8]]
Bools: TypeAlias = np.ndarray[Any, np.dtype[np.bool_]]
