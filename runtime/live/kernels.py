"""The compiled kernels, loaded without what compiling them would leave in the loop's memory."""

import os
import subprocess
import sys

from slam.estimator import Estimator
from slam.kernel_cache import is_kept, use_compile_cache
from slam.settings.slam import SlamSettings

COMPILE = (sys.executable, "-c", "from slam.estimator import Estimator; Estimator.warm_up()")


def load_kernels(settings: SlamSettings) -> None:
    """Load every kernel, so that the first tick is as quick as the others.

    Where the cache is empty a process of its own fills it: the compiler would leave 200 MB behind in this one. Should
    it fail, the kernels are compiled here.
    """
    cache = use_compile_cache(os.environ)
    if is_kept(cache) and not any(cache.rglob("*.nbi")):
        subprocess.run(COMPILE, check=False)
    Estimator.warm_up(settings)
