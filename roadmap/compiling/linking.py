"""How our compiled loops are optimised and linked: each body once, by LLVM.

Numba links the optimised bodies of all that a loop calls, directly or not, into it,
optimises the lot again and makes machine code of it, for each loop anew. With loops
that call each other a dozen deep, most of compiling is that. Here a loop is optimised
beside those callees alone that may be written into it, the small ones. A large loop
has machine code of its own, an object file, which all that call it share; a small one
that Python never calls has none.

What is kept of a loop holds the objects of all that it calls, so it is whole in itself;
whoever loads two loops loads what both call once. A name says the loop, its types and
its options, and what is kept is dropped when a source changes (`kernel_cache.py`): a
name has one meaning.

What is kept on disk has numba's own form and is loaded by numba alone; processes take
turns to write it (`kept_code.py`).
"""

import re
from contextlib import nullcontext
from typing import Any, NamedTuple
from weakref import WeakKeyDictionary

import llvmlite.binding as llvm
from llvmlite import ir
from numba import version_info
from numba.core.codegen import JITCodeLibrary
from numba.core.compiler import Compiler, CompilerBase, DefaultPassBuilder
from numba.core.compiler_lock import require_global_compiler_lock
from numba.core.registry import cpu_target

from roadmap.compiling.kept_code import guard_kept_code, undisturbed
from roadmap.compiling.lowering import keep_values, reach_elements_directly
from roadmap.compiling.passes import LoopPasses, quick
from roadmap.compiling.type_lookup import LookupContext, SharedFlagsPasses
from roadmap.compiling.wrapper import use_small_wrappers

# A callee that costs more is not written into its caller: LLVM gives up at 225, less
# what a call itself costs and what is known there; of those above nearly none was.
MOST_COST = 600
_STEP = re.compile(r"^  (?! )(?:\S+ = )?(?:tail )?(\w+)(.*)", re.MULTILINE)
_FREE = frozenset(
    "alloca bitcast extractvalue getelementptr insertvalue phi ret unreachable".split()
)
# Numba before drives LLVM in another way; of those after, nobody has looked.
KNOWN = (0, 62) <= version_info.short <= (0, 68)


guard_kept_code()


class LoopCompiler(CompilerBase):
    """Numba's own pipeline, with a library of ours to link and optimise in."""

    def __init__(self, *given: object) -> None:
        """Compile as numba's own does; see there."""
        super().__init__(*given)
        if KNOWN:
            self.state.typingctx = LookupContext(self.state.typingctx)
            reach_elements_directly(self.state.targetctx)
            use_small_wrappers(self.state.targetctx)

    def compile_extra(self, func: object) -> object:
        """Compile a function; Ctrl-C waits until that is done."""
        others = Compiler, "define_pipelines", _pipelines_of_numba
        with undisturbed(), quick(others) if KNOWN else nullcontext():
            return super().compile_extra(func)

    def define_pipelines(self) -> list:
        """Return the one pipeline; what it compiles goes into our library."""
        state = self.state
        if not KNOWN:
            return [DefaultPassBuilder.define_nopython_pipeline(state)]
        flags = state.flags
        has_wrapper = not (flags.no_cpython_wrapper and flags.no_cfunc_wrapper)
        _into_library(state, has_wrapper=has_wrapper, is_ours=True)
        passes = DefaultPassBuilder.define_nopython_pipeline(state)
        keep_values(passes)
        return [SharedFlagsPasses(LoopPasses(passes))]


_numbas = Compiler.define_pipelines


def _pipelines_of_numba(self: Compiler) -> list:
    """Return the pipeline of what our loops call of numba's own: no door, no code."""
    state = self.state
    if state.flags.force_pyobject:
        return _numbas(self)
    state.flags.no_cpython_wrapper = state.flags.no_cfunc_wrapper = True
    _into_library(state, has_wrapper=False, is_ours=False)
    return [LoopPasses(DefaultPassBuilder.define_nopython_pipeline(state))]


def _into_library(state: Any, **kind: bool) -> None:
    if state.library is None:
        name = state.func_id.func_qualname
        state.library = LoopLibrary(state.targetctx.codegen(), name)
        state.library.enable_object_caching()
        vars(state.library).update(kind)


class MachineCode(NamedTuple):
    """An object file.

    Attributes:
        code: It.
        calls: Large loops that it calls, by name.
        variables: Names of those variables that numba writes to when it loads a loop.
    """

    code: bytes
    calls: tuple[str, ...]
    variables: tuple[str, ...]


made: dict[str, MachineCode] = {}  # of large loops in this process, by name


def needed(names: tuple[str, ...]) -> dict[str, MachineCode]:
    """Return the machine code of loops and of all that they call."""
    found: dict[str, MachineCode] = {}
    todo = list(names)
    while todo:
        name = todo.pop()
        if name not in found:
            found[name] = made[name]
            todo += made[name].calls
    return found


class KeptCode:
    """Machine code of a loop as it is kept on disk: bytes, once it is loaded.

    Args:
        code: An object file.
        own: It, by the names under which others call it.
        others: All that it calls, directly or not.
    """

    def __init__(
        self, code: bytes, own: dict[str, MachineCode], others: dict[str, MachineCode]
    ) -> None:
        self._kept = code, own, others

    def __reduce__(self) -> tuple:
        """Pickle so that unpickling loads the code."""
        code, own, others = self._kept
        told = {name: (one.calls, one.variables) for name, one in own.items()}
        return _loaded, (code, told, {n: tuple(one) for n, one in others.items()})


def _loaded(code: bytes, own: dict, others: dict) -> bytes:
    """Load the machine code that a loop calls; return its own, which numba loads."""
    engine = cpu_target.target_context.codegen()._engine._ee
    for name, one in others.items():
        if name not in made:
            made[name] = MachineCode(*one)
            engine.add_object_file(llvm.ObjectFileRef.from_data(one[0]))
    for name, told in own.items():
        made.setdefault(name, MachineCode(code, *told))
    return code


class LoopLibrary(JITCodeLibrary):
    """The code of one loop.

    Attributes:
        has_wrapper: Whether Python calls it.
        is_ours: Whether it may have machine code of its own: a loop of numba's is
            linked into loops of others, too, which know of no code beside theirs.
    """

    has_wrapper = is_ours = True
    _final_module: llvm.ModuleRef
    _own: frozenset[str] = frozenset()  # functions of its own
    _calls: tuple[str, ...] = ()  # loops whose machine code its own calls

    def _optimize_functions(self, ll_module: llvm.ModuleRef) -> None:
        """Leave it to the one run over the module; there are no counts to prune."""
        ll_module.data_layout = str(self.codegen.target_data)

    def finalize(self) -> None:
        """Optimise the loop beside its small callees, and make its machine code."""
        require_global_compiler_lock()
        self._raise_if_finalized()
        module = self._final_module
        wanted = _declared(module)
        self._own = frozenset(f.name for f in module.functions) - wanted
        libraries = list(dict.fromkeys(self._linking_libraries))
        large: set[str] = set()
        for library in libraries:
            self._reload_init.update(library._reload_init)
            of_library = _large(library)
            large |= {name for name, is_large in of_library.items() if is_large}
            if any(not of_library.get(name, True) for name in wanted):
                module.link_in(library._get_module_for_linking(), preserve=True)
        for name in large - self._own:
            _pass_over(module, name)
        passes, builder = self.codegen._module_pass_manager()
        passes.run(module, builder)
        self._link_others(libraries)
        module.verify()
        self._calls = tuple(sorted(_declared(module) & made.keys()))
        self._finalize_final_module()

    def _link_others(self, libraries: list[JITCodeLibrary]) -> None:
        """Link what is called and has no machine code that is kept: numba's own."""
        module, linked = self._final_module, set()
        while True:
            wanted = _declared(module) - made.keys()
            new = [
                k
                for k, library in enumerate(libraries)
                if k not in linked and not wanted.isdisjoint(_large(library))
            ]
            if not new:
                return
            for k in new:
                linked.add(k)
                library = libraries[k]
                module.link_in(library._get_module_for_linking(), preserve=True)

    def _finalize_final_module(self) -> None:
        """Make machine code, if Python calls the loop or it is too large to vanish."""
        module = self._final_module
        shared = module.clone()  # machine code is made from a changed one
        for function in shared.functions:
            external = function.linkage == llvm.Linkage.external
            if external and not function.is_declaration:
                function.linkage = "linkonce_odr"
        self._shared_module = shared
        large = {name for name, large in _large_in(shared).items() if large}
        self._own &= large if self.is_ours else set()
        variables = {
            g.name for g in module.global_variables if g.linkage == llvm.Linkage.common
        }
        others = needed(self._calls)
        if not (self.has_wrapper or self._own):
            self._finalize_dynamic_globals()
            self._verify_declare_only_symbols()
            self._final_module = self._environments(variables)
        elif others:
            more = {v for one in others.values() for v in one.variables} - variables
            module.link_in(self._environments(more))
        super()._finalize_final_module()
        own = MachineCode(self._compiled_object, self._calls, tuple(sorted(variables)))
        made.update(dict.fromkeys(self._own, own))

    def serialize_using_object_code(self) -> tuple:
        """Return what numba keeps, with the machine code of all that it calls."""
        name, kind, (code, bitcode) = super().serialize_using_object_code()
        kept = KeptCode(code, {n: made[n] for n in self._own}, needed(self._calls))
        return name, kind, (kept, bitcode)

    def _environments(self, names: set[str]) -> llvm.ModuleRef:
        """Return a module that holds nothing but what numba writes to when loading."""
        module = ir.Module(self._final_module.name)
        module.triple = llvm.get_process_triple()
        for name in sorted(names):
            pointer = ir.GlobalVariable(module, ir.IntType(8).as_pointer(), name)
            pointer.linkage = "common"
            pointer.initializer = ir.Constant(pointer.value_type, None)
        new = llvm.parse_assembly(str(module))
        new.data_layout = str(self.codegen.target_data)
        return new


def _declared(module: llvm.ModuleRef) -> set[str]:
    return {f.name for f in module.functions if f.is_declaration}


_known: dict[str, bool] = {}  # whether a function is large; a body has one name
_known_in: WeakKeyDictionary[JITCodeLibrary, dict[str, bool]] = WeakKeyDictionary()


def _large(library: JITCodeLibrary) -> dict[str, bool]:
    """Return of every function in a library whether LLVM leaves it on its own."""
    if library not in _known_in:
        _known_in[library] = _large_in(library._get_module_for_linking())
    return _known_in[library]


def _large_in(module: llvm.ModuleRef) -> dict[str, bool]:
    found = {}
    for function in module.functions:
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
    cost = 0
    for code, rest in _STEP.findall(str(function)):
        if code == "call" and "@llvm." not in rest:
            cost += 25 + 5 * rest.count(",")
        elif code not in _FREE:
            cost += 5
    return cost > MOST_COST


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
