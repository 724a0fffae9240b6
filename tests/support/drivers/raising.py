"""An exception out of nowhere in another thread, as a defect or an interrupted library would raise it."""

import ctypes
import threading


class OutOfNowhere(BaseException):
    """Nobody catches it by name, and no `except Exception` does."""


def raise_in(name: str, error: type[BaseException] = OutOfNowhere) -> None:
    """Raise it in the one thread of this name at its next line of Python."""
    (thread,) = [thread for thread in threading.enumerate() if thread.name == name]
    assert thread.ident is not None
    assert ctypes.pythonapi.PyThreadState_SetAsyncExc(ctypes.c_ulong(thread.ident), ctypes.py_object(error)) == 1
