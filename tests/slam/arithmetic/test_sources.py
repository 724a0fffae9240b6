"""Nothing in slam asks a library whose code depends on the processor (decision 49)."""

import ast
import re
from collections.abc import Iterator
from pathlib import Path

from runtime.source_tree import ROOT

OF_MATH = re.compile("a?(sin|cos|tan)h?|atan2|exp(2|m1)?|log(1p|2|10)?|pow|cbrt|erfc?|l?gamma")
OF_NUMPY = re.compile(
    "(arc)?(sin|cos|tan)h?|arctan2|exp(2|m1)?|log(1p|2|10|addexp)?|(float_)?power|cbrt|hypot|sinc|angle|unwrap|"
    "(geom|log)space|linalg|v?dot|inner|matmul|tensordot|einsum|vecdot|cov|corrcoef|polyfit|kron|convolve|correlate"
)
OF_OBJECTS = re.compile("dot|(standard_|multivariate_|log)?normal|(standard_)?exponential|gamma|beta")
NONE = re.compile("(?!)")
OF_TOOLS = {"rotated", "composed", "inverted"}
"""Functions of slam/pose.py over rows of poses, for tools that do not load the compiler: no step calls them."""


def asked(path: Path) -> Iterator[str]:
    """Where a file names one of these: line and name."""
    tree = ast.parse(path.read_text())
    if path.name == "pose.py":
        tree.body = [part for part in tree.body if getattr(part, "name", "") not in OF_TOOLS]
    for node in ast.walk(tree):
        where = f"{path.relative_to(ROOT)}:{getattr(node, 'lineno', 0)}"
        if isinstance(node, ast.Attribute):
            owner = node.value.id if isinstance(node.value, ast.Name) else ""
            names = {"math": OF_MATH, "np": OF_NUMPY, "elementary": NONE}.get(owner, OF_OBJECTS)
            if names.fullmatch(node.attr):
                yield f"{where} {owner}.{node.attr}"
        elif isinstance(node, ast.BinOp | ast.AugAssign) and isinstance(node.op, ast.Pow):
            yield f"{where} **"
        elif isinstance(node, ast.ImportFrom) and node.module in ("math", "numpy", "scipy", "cmath"):
            yield f"{where} from {node.module}"
        elif isinstance(node, ast.ImportFrom) and node.module == "slam.pose":
            yield from (f"{where} {alias.name}" for alias in node.names if alias.name in OF_TOOLS)


def test_slam_asks_no_blas_no_libm_and_no_function_that_numpy_chooses_by_the_processor() -> None:
    allowed = {"np.linalg"}  # for LinAlgError, in the module that stands in its place
    found = [
        entry
        for path in sorted((ROOT / "slam").rglob("*.py"))
        for entry in asked(path)
        if not ("small_matrices.py" in entry and entry.split()[-1] in allowed)
    ]
    assert not found, "\n".join(found)
