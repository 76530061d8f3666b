"""Lets the Python reference be imported without torch. Not a program."""

import sys
import types


def stand_in_for_torch():
    """Lets the package be imported without torch, for whose absence README.md gives the reasons.

    The measured code asks torch one question, `is_tensor`, of values that are numpy arrays. Everything else is a
    name in an annotation or a base class of a model that is never made.
    """

    class Names(type):
        """Any attribute is one more empty class."""

        def __getattr__(cls, name):
            if name.startswith("__"):
                raise AttributeError(name)
            return Names(name, (Absent,), {})

    class Absent(metaclass=Names):
        def __init__(self, *args, **kwargs):
            pass

        def __call__(self, decorated):
            return decorated

    class Module(types.ModuleType):
        def __getattr__(self, name):
            return getattr(Absent, name)

    def module(name):
        made = sys.modules[name] = Module(name)
        made.__path__ = []
        return made

    torch, nn, vision = module("torch"), module("torch.nn"), module("torchvision")
    torch.nn, nn.functional, vision.tv_tensors = nn, module("torch.nn.functional"), module("torchvision.tv_tensors")
    torch.is_tensor = lambda value: False
