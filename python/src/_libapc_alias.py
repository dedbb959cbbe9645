# SPDX-License-Identifier: BSD-3-Clause
"""The former name of the package, `apc`, where no other package has it: deprecated, and gone in the next version.

libapc.pth imports this when the interpreter starts, so it stays small. A package `apc` of somebody else is found first.
"""

import sys

WORD = "the package is libapc: write `import libapc as apc`"


class _Alias:
    """Finds and loads apc and apc.X as libapc and libapc.X: the same modules."""

    def find_spec(self, name, path=None, target=None):
        ours = name.startswith("apc.") and sys.modules.get("apc") is sys.modules.get("libapc")
        if name != "apc" and not ours:
            return None
        from importlib.machinery import ModuleSpec
        from importlib.util import find_spec
        real = find_spec("lib" + name)
        if real is None:
            return None
        if name == "apc":
            import warnings
            warnings.warn(WORD, DeprecationWarning, stacklevel=2)
            sys.meta_path.remove(self)
            sys.meta_path.insert(0, self)  # what is below is ours as well
        return ModuleSpec(name, self, origin=real.origin, is_package=real.submodule_search_locations is not None)

    def create_module(self, spec):
        from importlib import import_module
        module = import_module("lib" + spec.name)
        spec.loader_state = module.__spec__
        return module

    def exec_module(self, module):
        module.__spec__ = module.__spec__.loader_state  # it has been executed, as what it is

    def get_code(self, name):
        from importlib.util import find_spec
        return find_spec("lib" + name).loader.get_code("lib" + name)  # python -m libapc.X


sys.meta_path.append(_Alias())
