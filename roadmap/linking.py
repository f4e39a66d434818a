"""How our compiled loops are optimised and linked: each body once, by LLVM.

Numba links the optimised bodies of all that a loop calls, directly or not, into it,
optimises the lot again and makes machine code of it, for each loop anew. With loops
that call each other a dozen deep, most of compiling is that. Here a loop is optimised
beside those callees alone that may be written into it, the small ones. The others are
known by name until that is done, and their bodies, optimised already, are linked
then. And a loop that Python never calls gets no machine code of its own: whatever
calls it holds its body. Nothing is left to be found at run time.

What is kept on disk has numba's own form and is loaded by numba alone; processes take
turns to write it (`cache_lock.py`).
"""

from itertools import islice

import llvmlite.binding as llvm
from llvmlite import ir
from numba import version_info
from numba.core import config
from numba.core.codegen import JITCodeLibrary
from numba.core.compiler import CompilerBase, DefaultPassBuilder
from numba.core.compiler_lock import require_global_compiler_lock

from roadmap.cache_lock import save_in_turn
from roadmap.door import give_small_doors
from roadmap.type_lookup import LookupContext, SharedFlagsPasses

# A callee of more instructions is not written into its caller: LLVM gives up at about
# 55 that cost it something, and few of the others cost nothing.
MOST_INSTRUCTIONS = 300
# Numba before drives LLVM in another way; of those after, nobody has looked.
KNOWN = (0, 62) <= version_info.short <= (0, 68)


save_in_turn()


class LoopCompiler(CompilerBase):
    """Numba's own pipeline, with a library of ours to link and optimise in."""

    def __init__(self, *given: object) -> None:
        """Compile as numba's own does; see there."""
        super().__init__(*given)
        if KNOWN:
            self.state.typingctx = LookupContext(self.state.typingctx)
            give_small_doors(self.state.targetctx)

    def define_pipelines(self) -> list:
        """Return the one pipeline; what it compiles goes into our library."""
        state = self.state
        ours = KNOWN and config.OPT != 0
        if ours and state.library is None:
            library = LoopLibrary(
                state.targetctx.codegen(), state.func_id.func_qualname
            )
            library.has_door = not (
                state.flags.no_cpython_wrapper and state.flags.no_cfunc_wrapper
            )
            library.enable_object_caching()
            state.library = library
        passes = DefaultPassBuilder.define_nopython_pipeline(state)
        if KNOWN:
            passes = SharedFlagsPasses(passes)
        return [passes]


class LoopLibrary(JITCodeLibrary):
    """The code of one loop.

    Attributes:
        has_door: Whether Python calls it, so that it needs machine code.
    """

    has_door = True
    _final_module: llvm.ModuleRef

    def _optimize_functions(self, ll_module: llvm.ModuleRef) -> None:
        """Leave it to the one run over the module; there are no counts to prune."""
        ll_module.data_layout = str(self.codegen.target_data)

    def finalize(self) -> None:
        """Optimise the loop beside its small callees, then link all it calls."""
        require_global_compiler_lock()
        self._raise_if_finalized()
        module = self._final_module
        functions = list(module.functions)
        wanted = {f.name for f in functions if f.is_declaration}
        own = {f.name for f in functions} - wanted
        libraries = list(dict.fromkeys(self._linking_libraries))
        large: set[str] = set()
        for library in libraries:
            self._reload_init.update(library._reload_init)
            of_library = _large(library)
            large |= {name for name, is_large in of_library.items() if is_large}
            if any(not of_library.get(name, True) for name in wanted):
                module.link_in(library._get_module_for_linking(), preserve=True)
        for name in large - own:
            _pass_over(module, name)
        passes, builder = self.codegen._module_pass_manager()
        passes.run(module, builder)
        for library in libraries:
            module.link_in(library._get_module_for_linking(), preserve=True)
        module.verify()
        self._finalize_final_module()

    def _finalize_final_module(self) -> None:
        """Make machine code, of the loop if Python calls it, else of no function."""
        shared = self._final_module.clone()  # machine code is made from a changed one
        for function in shared.functions:
            external = function.linkage == llvm.Linkage.external
            if external and not function.is_declaration:
                function.linkage = "linkonce_odr"
        self._shared_module = shared
        if not self.has_door:
            self._finalize_dynamic_globals()
            self._verify_declare_only_symbols()
            self._final_module = self._environments()
        super()._finalize_final_module()

    def _environments(self) -> llvm.ModuleRef:
        """Return a module that holds nothing but what numba writes to when loading."""
        module = ir.Module(self._final_module.name)
        module.triple = llvm.get_process_triple()
        names = [
            g.name
            for g in self._final_module.global_variables
            if g.linkage == llvm.Linkage.common
        ]
        for name in names:
            pointer = ir.GlobalVariable(module, ir.IntType(8).as_pointer(), name)
            pointer.linkage = "common"
            pointer.initializer = ir.Constant(pointer.value_type, None)
        new = llvm.parse_assembly(str(module))
        new.data_layout = str(self.codegen.target_data)
        return new


_known: dict[str, bool] = {}  # whether a function is large; a body has one name


def _large(library: JITCodeLibrary) -> dict[str, bool]:
    """Return of every function in a library whether LLVM leaves it on its own."""
    functions = library._get_module_for_linking().functions
    found = {}
    for function in functions:
        name = function.name
        if not function.is_declaration:
            if name not in _known:
                _known[name] = _is_large(function)
            found[name] = _known[name]
    return found


def _is_large(function: llvm.ValueRef) -> bool:
    """Return True if LLVM will not write a function into what calls it."""
    if any(b"alwaysinline" in a for a in function.attributes):
        return False
    instructions = (i for block in function.blocks for i in block.instructions)
    return next(islice(instructions, MOST_INSTRUCTIONS, None), None) is not None


def _pass_over(module: llvm.ModuleRef, name: str) -> None:
    """Let LLVM pass over a function, and drop its body in the end."""
    try:
        function = module.get_function(name)
    except NameError:  # nothing calls it here
        return
    if not function.is_declaration:
        function.linkage = "available_externally"
        function.add_function_attribute("noinline")
        function.add_function_attribute("optnone")
