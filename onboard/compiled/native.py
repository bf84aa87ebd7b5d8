"""Machine code of the kernels of one module as an object file.

It uses Numba's internals, so pyproject.toml bounds the version. `aim` changes this process's Numba for good: what
is compiled from then on is for a file, and cannot be called here.
"""

from collections.abc import Callable
from importlib import import_module
from typing import Any, Final, NamedTuple

from llvmlite import binding, ir
from numba import njit, types
from numba.core import cpu
from numba.core.codegen import AOTCPUCodegen
from numba.core.compiler_lock import global_compiler_lock
from numba.core.registry import cpu_target
from numba.core.runtime import nrtdynmod
from numba.extending import overload
from numba.np import arrayobj

from onboard.compiled.kinds import name_of
from onboard.compiled.machine import Processor
from onboard.compiled.numba_types import Specification, numba_type
from onboard.compiled.parts import Entry, Part

SLOT_TYPE: Final = ir.IntType(64)
SLOTS_TYPE: Final = SLOT_TYPE.as_pointer()
CODE: Final = ir.IntType(32)
MAX_SLOT_COUNT: Final = 256  # as SLOTS of boundary.c


class Declared(NamedTuple):
    """A kernel for Python: the function, the types of its arguments, and Numba's options."""

    function: Callable[..., Any]
    takes: tuple[Any, ...]
    options: dict[str, Any]
    dispatcher: Any


DECLARED: Final[list[Declared]] = []  # by the modules that this process has imported


def declared(function: Any, takes: tuple[Any, ...] | None, options: dict[str, Any]) -> Any:
    """A kernel that Numba compiles for a file on request, with these types alone if any."""
    compile_later: Any = njit
    dispatcher = compile_later(no_cpython_wrapper=True, no_cfunc_wrapper=True, **options)(function)
    if takes is not None:
        DECLARED.append(Declared(function, takes, options, dispatcher))
        find = dispatcher.get_call_template

        def get_call_template(arguments: Any, by_name: Any) -> Any:
            _compiled(dispatcher, takes)
            return find(arguments, by_name)

        dispatcher.get_call_template = get_call_template
    return dispatcher


def _compiled(dispatcher: Any, takes: tuple[Any, ...]) -> Any:
    """Numba's result of a kernel for its arguments."""
    arguments = tuple(numba_type(kind) for kind in takes)
    if arguments not in dispatcher.overloads:
        dispatcher.compile(arguments)
        dispatcher.disable_compile()
    return dispatcher.overloads[arguments]


def _raise_of_shapes(shapes: Any, index_shape: Any) -> None:
    """Raise ValueError for an array that does not fit where a kernel puts it."""
    raise NotImplementedError


@overload(_raise_of_shapes)
def _raise_of_shapes_compiled(shapes: Any, index_shape: Any) -> Callable[[Any, Any], None]:  # noqa: ARG001
    def raise_(shapes: Any, index_shape: Any) -> None:  # noqa: ARG001 - by these names
        raise ValueError("cannot assign slice from input of different shape")

    return raise_


def aim(target: Processor) -> None:
    """Compile for a processor from now on."""

    class Codegen(AOTCPUCodegen):
        def _customize_tm_features(self) -> str:
            return target.more

    class Context(cpu.CPUContext):
        aot_mode = True

        def get_executable(self, library: Any, *_: Any) -> Any:
            return [library].append  # only its identity counts: nothing runs here

    context: Any = Context(cpu_target.typing_context, "cpu")
    context._internal_codegen = Codegen("kernels", cpu_name=target.cpu)  # noqa: SLF001 - as pycc does
    cpu_target.__dict__["_toplevel_target_context"] = context
    context.refresh()
    # The message of Numba's own function takes text in machine code, in kernels that print nothing.
    arrayobj.raise_with_shape_context = _raise_of_shapes


@global_compiler_lock
def module_part(name: str) -> Part:
    """The machine code of the kernels of a module that Python may call."""
    import_module(name)
    ours = [one for one in DECLARED if one.function.__module__ == name]
    if not ours:
        return Part([], b"")
    context: Any = cpu_target.target_context
    library = context.codegen().create_library(name)
    memory, _ = nrtdynmod.create_nrt_module(context)
    library.add_ir_module(memory)
    entries = [_added(context, library, one) for one in ours]
    library.finalize()
    _hide(library._final_module, {entry.symbol for entry in entries}, context)  # noqa: SLF001 - there is no other way
    return Part(entries, library.emit_native_object())


def _hide(module: Any, exported: set[str], context: Any) -> None:
    """Hide all but the exported functions from other files, and drop unused ones."""
    for one in (*module.functions, *module.global_variables):
        if not one.is_declaration and one.name not in exported:
            one.linkage = "internal"
    passes = binding.create_new_module_pass_manager()
    passes.add_global_dead_code_eliminate_pass()
    machine = context.codegen()._tm  # noqa: SLF001 - as above
    passes.run(module, binding.create_pass_builder(machine, binding.create_pipeline_tuning_options()))


def _added(context: Any, library: Any, one: Declared) -> Entry:
    """A function that Python may call, put into a library."""
    made = _compiled(one.dispatcher, one.takes)
    library.add_linking_library(made.library)
    name = name_of(one.function)
    symbol = f"kernel_{name.replace('.', '_')}"
    _write_entry(context, library, made, symbol)
    spec = Specification()
    takes = "".join(spec.of(kind) for kind in made.signature.args)
    gives = spec.of(made.signature.return_type)
    return Entry(name, takes, gives, spec.class_names(), symbol, bool(one.options.get("nogil")))


def _write_entry(context: Any, library: Any, made: Any, symbol: str) -> None:
    """Write int symbol(i64 *in, i64 *out), which calls the kernel with the slots' values.

    It returns 0, or 1 for an exception, whose pickle's address (0 if none) and size are then in `out`.
    """
    module = library.create_ir_module(symbol)
    function = ir.Function(module, ir.FunctionType(CODE, (SLOTS_TYPE, SLOTS_TYPE)), symbol)
    builder = ir.IRBuilder(function.append_basic_block())
    source, target = (_Slots(builder, argument) for argument in function.args)
    arguments, result = made.signature.args, made.signature.return_type
    values = [_native(context, builder, source, kind) for kind in arguments]
    callee = context.declare_function(module, made.fndesc)
    status, value = context.call_conv.call_function(builder, callee, result, arguments, values)
    with builder.if_then(status.is_error, likely=False):
        _store_exception(builder, status, _Slots(builder, function.args[1]))
        builder.ret(CODE(1))
    _store(context, builder, target, result, value)
    builder.ret(CODE(0))
    library.add_ir_module(module)


def _store_exception(builder: Any, status: Any, slots: "_Slots") -> None:
    nothing = builder.icmp_unsigned("==", status.excinfoptr, status.excinfoptr.type(None))
    with builder.if_else(builder.or_(nothing, builder.not_(status.is_user_exc))) as (without, with_it):
        with without:
            _Slots(builder, slots.start).put(SLOT_TYPE(0))
        with with_it:
            raised = builder.load(status.excinfoptr)
            slots.put(builder.ptrtoint(builder.extract_value(raised, 0), SLOT_TYPE))
            slots.put(builder.sext(builder.extract_value(raised, 1), SLOT_TYPE))


class _Slots:
    """Slots one after the other."""

    def __init__(self, builder: Any, start: Any) -> None:
        self.start = start
        self._builder, self._next = builder, 0

    def _place(self) -> Any:
        place = self._builder.gep(self.start, [CODE(self._next)])
        self._next += 1
        if self._next > MAX_SLOT_COUNT:
            raise ValueError(f"a kernel takes or returns more than {MAX_SLOT_COUNT} numbers")
        return place

    def take(self) -> Any:
        """The value in the next one."""
        return self._builder.load(self._place())

    def put(self, value: Any) -> None:
        """Put a value into the next one."""
        self._builder.store(value, self._place())


def _native(context: Any, builder: Any, slots: _Slots, kind: Any) -> Any:
    """The value of an argument."""
    if isinstance(kind, types.Array):
        array = context.make_array(kind)(context, builder)
        parent, data = (builder.inttoptr(slots.take(), field.type) for field in (array.parent, array.data))
        shape, strides = ([slots.take() for _ in range(kind.ndim)] for _ in range(2))
        size = SLOT_TYPE(context.get_abi_sizeof(context.get_data_type(kind.dtype)))
        arrayobj.populate_array(array, data, shape, strides, size, meminfo=None, parent=parent)
        return array._getvalue()  # noqa: SLF001 - as Numba's own code
    if isinstance(kind, types.BaseTuple):
        return context.make_tuple(builder, kind, [_native(context, builder, slots, each) for each in kind.types])
    if isinstance(kind, types.Float):
        return builder.bitcast(slots.take(), context.get_value_type(kind))
    if isinstance(kind, types.Boolean):
        return builder.icmp_unsigned("!=", slots.take(), SLOT_TYPE(0))
    return slots.take()


def _store(context: Any, builder: Any, slots: _Slots, kind: Any, value: Any) -> None:
    """Put a result into slots."""
    if isinstance(kind, types.Array):
        array = context.make_array(kind)(context, builder, value=value)
        for pointer in (array.meminfo, array.parent, array.data):
            slots.put(builder.ptrtoint(pointer, SLOT_TYPE))
        for axes in (array.shape, array.strides):
            for k in range(kind.ndim):
                slots.put(builder.extract_value(axes, k))
    elif isinstance(kind, types.BaseTuple):
        for k, each in enumerate(kind.types):
            _store(context, builder, slots, each, builder.extract_value(value, k))
    elif isinstance(kind, types.Boolean):
        slots.put(builder.zext(value, SLOT_TYPE))
    elif isinstance(types.unliteral(kind), types.Float):
        slots.put(builder.bitcast(value, SLOT_TYPE))
    elif not isinstance(kind, types.NoneType):
        slots.put(value)
