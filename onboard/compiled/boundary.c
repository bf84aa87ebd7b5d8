/* Between Python and the machine code of the kernels: checks and unpacks arguments, packs what a kernel returns.

It needs no header: of Python, functions of the stable ABI alone; of NumPy, what is the same in 1.x and 2.x (the
fields of arrays and element types, and places in its table of functions). A kernel gets and gives 64-bit slots, in
the order of its specification: a letter for each number, for an array its element type, its number of axes and how
it may lie in memory, and a tuple's elements in parentheses, after the letter of its class. `compiled.py` writes it. */

typedef long long i64;
typedef unsigned long long u64;
typedef unsigned char u8;

typedef struct Object { i64 references; struct Object *type; } Object;
typedef struct { Object head; Object *scalar; char kind, letter, byte_order, flags; int number; } ElementType;
typedef struct {
    Object head;
    char *data;
    int ndim;
    i64 *shape, *strides;
    Object *base;
    ElementType *element;
    int flags;
} Array;
typedef struct { const char *name; void *function; int flags; const char *doc; } Method;
typedef struct { Object head; void *init; i64 index; Object *copy; } ModuleBase;
typedef struct { ModuleBase base; const char *name, *doc; i64 size; Method *methods; void *slots[4]; } Module;
typedef struct { u64 references; void (*release)(void *, u64, void *); u64 grows; void *data; u64 size; } Memory;

typedef struct {
    const char *name, *takes, *gives, *class_names;
    int (*run)(i64 *in, i64 *out);
    int releases_lock;
    Object *classes; /* a tuple */
    Method method;
} Kernel;

extern Kernel kernels[];
extern const int kernel_count;
extern const char digest[], sources[];

extern Object _Py_TrueStruct, _Py_FalseStruct, _Py_NoneStruct, *PyExc_TypeError, *PyExc_RuntimeError, *PyExc_KeyError;
void Py_IncRef(Object *), Py_DecRef(Object *), PyErr_SetObject(Object *, Object *), PyErr_Clear(void);
void *PyErr_Format(Object *, const char *, ...), *PyErr_Occurred(void), *PyEval_SaveThread(void);
void PyEval_RestoreThread(void *);
int PyType_IsSubtype(Object *, Object *), PyTuple_SetItem(Object *, i64, Object *);
int PyModule_AddStringConstant(Object *, const char *, const char *);
i64 PyTuple_Size(Object *), PyLong_AsLongLong(Object *);
u64 PyLong_AsUnsignedLongLong(Object *);
double PyFloat_AsDouble(Object *);
const char *PyUnicode_AsUTF8AndSize(Object *, i64 *);
Object *PyTuple_GetItem(Object *, i64), *PyTuple_New(i64), *PyFloat_FromDouble(double), *PyLong_FromLongLong(i64);
Object *PyLong_FromUnsignedLongLong(u64), *PyNumber_Index(Object *), *PyImport_ImportModule(const char *);
Object *PyObject_GetAttrString(Object *, const char *), *PyObject_CallObject(Object *, Object *);
Object *PyBytes_FromStringAndSize(const char *, i64), *PyObject_CallMethod(Object *, const char *, const char *, ...);
Object *PyCapsule_New(void *, const char *, void (*)(Object *)), *PyUnicode_FromString(const char *);
void *PyCapsule_GetPointer(Object *, const char *);
Object *PyCMethod_New(Method *, Object *, Object *, Object *), *PyModule_Create2(Module *, int);
void *malloc(u64), free(void *), *realloc(void *, u64);
int strcmp(const char *, const char *);

enum { SLOTS = 256, FASTCALL = 0x80, VARARGS = 1, CONTIGUOUS = 1, ALIGNED = 0x100, WRITEABLE = 0x400 };
enum { ARRAY_TYPE = 2, BOOL_TYPE = 8, NEW_ARRAY = 93, SET_BASE = 282 }; /* in NumPy's table */

static void **numpy;

static int is_a(Object *object, Object *type) {
    return object->type == type || PyType_IsSubtype(object->type, type);
}

/* ------------------------------------------------------------------------------------------------ memory

Blocks of memory that count who uses them, as Numba lays them out. `release` is called for what is in one before its
memory is freed; data that may grow is a block of its own. */

void *NRT_Allocate(u64 size) { return malloc(size); }

void NRT_Free(void *data) { free(data); }

void NRT_MemInfo_call_dtor(Memory *memory) {
    if (memory->release)
        memory->release(memory->data, memory->size, 0);
    if (memory->grows)
        free(memory->data);
    free(memory);
}

Memory *NRT_MemInfo_alloc_safe_aligned(u64 size, unsigned align) {
    Memory *memory = malloc(sizeof(Memory) + size + align);
    if (!memory)
        return 0;
    u64 data = ((u64)(memory + 1) + align - 1) / align * align;
    *memory = (Memory){1, 0, 0, (void *)data, size};
    return memory;
}

Memory *NRT_MemInfo_alloc_aligned(u64 size, unsigned align) { return NRT_MemInfo_alloc_safe_aligned(size, align); }

Memory *NRT_MemInfo_alloc(u64 size) { return NRT_MemInfo_alloc_safe_aligned(size, 16); }

Memory *NRT_MemInfo_new_varsize_dtor(u64 size, void (*release)(void *, u64, void *)) {
    Memory *memory = malloc(sizeof(Memory));
    void *data = malloc(size);
    if (!memory || !data) {
        free(memory);
        free(data);
        return 0;
    }
    *memory = (Memory){1, release, 1, data, size};
    return memory;
}

void *NRT_MemInfo_varsize_realloc(Memory *memory, u64 size) {
    void *data = realloc(memory->data, size);
    if (data) {
        memory->data = data;
        memory->size = size;
    }
    return data;
}

static void let_go(Memory *memory) {
    if (memory && __atomic_sub_fetch(&memory->references, 1, __ATOMIC_ACQ_REL) == 0)
        NRT_MemInfo_call_dtor(memory);
}

static void end_of_capsule(Object *capsule) { let_go(PyCapsule_GetPointer(capsule, 0)); }

/* ------------------------------------------------------------------------------------- arguments, results */

static int number_of(char letter) { /* NumPy's, of an element type */
    return letter == 'd' ? 12 : letter == 'l' ? 7 : letter == 'u' ? 8 : 0;
}

static i64 size_of(char letter) { return letter == '?' ? 1 : 8; }

/* Unpack one argument into slots; what follows its specification, or 0 if it is of another type. */
static const char *take(const char *spec, Object *argument, Object *classes, i64 **slots) {
    char letter = *spec++;
    if (letter == 'A') {
        Array *array = (Array *)argument;
        if (!is_a(argument, numpy[ARRAY_TYPE]))
            return 0;
        int number = array->element->number, must = ALIGNED, ndim = spec[1] - '0';
        number = number == 9 ? 7 : number == 10 ? 8 : number; /* long long is long */
        must |= spec[2] == 'w' || spec[2] == 'm' ? WRITEABLE : 0;
        must |= spec[2] == 'w' || spec[2] == 'c' ? CONTIGUOUS : 0;
        if (number != number_of(*spec) || array->ndim != ndim || (array->flags & must) != must ||
            array->element->byte_order == '>')
            return 0;
        *(*slots)++ = (i64)argument;
        *(*slots)++ = (i64)array->data;
        for (int k = 0; k < ndim; k++)
            *(*slots)++ = array->shape[k];
        for (int k = 0; k < ndim; k++)
            *(*slots)++ = array->strides[k];
        return spec + 3;
    }
    if (letter == '(') {
        int class = *spec++ - '0', count = *spec++ - '0';
        Object *type = PyTuple_GetItem(classes, class);
        if (class ? argument->type != type : !is_a(argument, type))
            return 0;
        if (PyTuple_Size(argument) != count)
            return 0;
        for (int k = 0; k < count && spec; k++)
            spec = take(spec, PyTuple_GetItem(argument, k), classes, slots);
        return spec;
    }
    if (letter == 'd') {
        double number = PyFloat_AsDouble(argument);
        if ((number == -1.0 && PyErr_Occurred()) || is_a(argument, numpy[ARRAY_TYPE]))
            return 0;
        *(double *)(*slots)++ = number;
        return spec;
    }
    if (letter == '?') {
        int is_true = argument == &_Py_TrueStruct;
        if (!is_true && argument != &_Py_FalseStruct) {
            if (argument->type != numpy[BOOL_TYPE])
                return 0;
            is_true = ((u8 *)argument)[sizeof(Object)];
        }
        *(*slots)++ = is_true;
        return spec;
    }
    Object *whole = is_a(argument, numpy[ARRAY_TYPE]) ? 0 : PyNumber_Index(argument);
    if (!whole)
        return 0;
    *(*slots)++ = letter == 'u' ? (i64)PyLong_AsUnsignedLongLong(whole) : PyLong_AsLongLong(whole);
    Py_DecRef(whole);
    return PyErr_Occurred() ? 0 : spec;
}

static Object *array_of(char letter, int ndim, i64 **slots) {
    Memory *memory = (Memory *)*(*slots)++;
    Array *parent = (Array *)*(*slots)++;
    void *data = (void *)*(*slots)++;
    i64 *shape = *slots, *strides = shape + ndim;
    *slots = strides + ndim;
    int is_parent = parent && parent->data == data && parent->ndim == ndim;
    for (int k = 0; k < ndim && is_parent; k++)
        is_parent = parent->shape[k] == shape[k] && parent->strides[k] == strides[k];
    if (is_parent) {
        let_go(memory);
        Py_IncRef(&parent->head);
        return &parent->head;
    }
    Object *(*make)(Object *, int, i64 *, int, i64 *, void *, int, int, Object *) = numpy[NEW_ARRAY];
    int (*set_base)(Object *, Object *) = numpy[SET_BASE];
    Object *array = make(numpy[ARRAY_TYPE], ndim, shape, number_of(letter), strides, data, 0, ALIGNED | WRITEABLE, 0);
    Object *base = memory ? PyCapsule_New(memory, 0, end_of_capsule) : parent ? &parent->head : &_Py_NoneStruct;
    if (!memory)
        Py_IncRef(base);
    if (array && base && set_base(array, base) == 0)
        return array;
    return 0;
}

/* Pack one result; it moves on in the specification and in the slots. 0 with an exception if there is no memory. */
static Object *give(const char **spec, Object *classes, i64 **slots) {
    char letter = *(*spec)++;
    if (letter == 'A') {
        char element = (*spec)[0];
        int ndim = (*spec)[1] - '0';
        *spec += 3;
        return array_of(element, ndim, slots);
    }
    if (letter == '(') {
        int class = *(*spec)++ - '0', count = *(*spec)++ - '0';
        Object *tuple = PyTuple_New(count);
        for (int k = 0; k < count && tuple; k++) {
            Object *one = give(spec, classes, slots);
            if (!one) {
                Py_DecRef(tuple);
                return 0;
            }
            PyTuple_SetItem(tuple, k, one);
        }
        if (!class || !tuple)
            return tuple;
        Object *named = PyObject_CallObject(PyTuple_GetItem(classes, class), tuple);
        Py_DecRef(tuple);
        return named;
    }
    if (letter == 'd')
        return PyFloat_FromDouble(*(double *)(*slots)++);
    if (letter == '?') {
        Object *found = *(*slots)++ ? &_Py_TrueStruct : &_Py_FalseStruct;
        Py_IncRef(found);
        return found;
    }
    if (letter == 'l' || letter == 'u') {
        i64 number = *(*slots)++;
        return letter == 'l' ? PyLong_FromLongLong(number) : PyLong_FromUnsignedLongLong(number);
    }
    Py_IncRef(&_Py_NoneStruct);
    return &_Py_NoneStruct;
}

/* The exception that a kernel raised: its class, arguments and place, pickled. */
static Object *raised(Kernel *kernel, const char *pickled, i64 size) {
    Object *pickle = pickled ? PyImport_ImportModule("pickle") : 0;
    Object *bytes = pickle ? PyBytes_FromStringAndSize(pickled, size) : 0;
    Object *found = bytes ? PyObject_CallMethod(pickle, "loads", "(N)", bytes) : 0;
    Object *arguments = found ? PyTuple_GetItem(found, 1) : 0;
    if (arguments && arguments != &_Py_NoneStruct)
        PyErr_SetObject(PyTuple_GetItem(found, 0), PyTuple_Size(arguments) == 1 ? PyTuple_GetItem(arguments, 0) : arguments);
    else if (!PyErr_Occurred())
        PyErr_Format(PyExc_RuntimeError, "%s failed", kernel->name);
    if (pickle)
        Py_DecRef(pickle);
    if (found)
        Py_DecRef(found);
    return 0;
}

static Object *call(Object *self, Object *const *arguments, i64 count) {
    Kernel *kernel = PyCapsule_GetPointer(self, 0);
    i64 in[SLOTS], out[SLOTS], *slots = in;
    const char *spec = kernel->takes;
    i64 k = 0;
    for (; k < count && *spec; k++) {
        const char *after = take(spec, arguments[k], kernel->classes, &slots);
        if (!after) {
            PyErr_Clear();
            return PyErr_Format(PyExc_TypeError, "%s: argument %d of another type, or another layout in memory",
                kernel->name, (int)k + 1);
        }
        spec = after;
    }
    if (k < count || *spec)
        return PyErr_Format(PyExc_TypeError, "%s: called with %d arguments, which are too %s", kernel->name, (int)count,
            *spec ? "few" : "many");
    void *state = kernel->releases_lock ? PyEval_SaveThread() : 0;
    int failed = kernel->run(in, out);
    if (state)
        PyEval_RestoreThread(state);
    if (failed)
        return raised(kernel, (char *)out[0], out[1]);
    spec = kernel->gives;
    slots = out;
    return give(&spec, kernel->classes, &slots);
}

static Kernel *named(Object *const *arguments) {
    const char *name = PyUnicode_AsUTF8AndSize(arguments[0], 0);
    for (int k = 0; k < kernel_count && name; k++)
        if (strcmp(kernels[k].name, name) == 0)
            return &kernels[k];
    if (name)
        PyErr_SetObject(PyExc_KeyError, arguments[0]);
    return 0;
}

/* class_names(name): the classes, as "module:name", whose tuples the kernel of that name takes or gives. */
static Object *class_names(Object *self, Object *const *arguments, i64 count) {
    Kernel *kernel = count == 1 ? named(arguments) : 0;
    return kernel ? PyUnicode_FromString(kernel->class_names) : 0;
}

/* bind(name, classes): the function of that name. */
static Object *bind(Object *self, Object *const *arguments, i64 count) {
    Kernel *kernel = count == 2 ? named(arguments) : 0;
    if (!kernel)
        return 0;
    Py_IncRef(arguments[1]);
    kernel->classes = arguments[1];
    kernel->method = (Method){kernel->name, call, FASTCALL, 0};
    Object *capsule = PyCapsule_New(kernel, 0, 0);
    return capsule ? PyCMethod_New(&kernel->method, capsule, 0, 0) : 0;
}

static Method methods[] = {{"bind", bind, FASTCALL, 0}, {"class_names", class_names, FASTCALL, 0}, {0, 0, 0, 0}};
static Module module = {{{1, 0}, 0, 0, 0}, "kernels", 0, -1, methods, {0, 0, 0, 0}};

__attribute__((visibility("default"))) Object *PyInit_kernels(void) {
    Object *inner = PyImport_ImportModule("numpy._core._multiarray_umath");
    Object *table = inner ? PyObject_GetAttrString(inner, "_ARRAY_API") : 0;
    numpy = table ? PyCapsule_GetPointer(table, 0) : 0;
    Object *made = numpy ? PyModule_Create2(&module, 1013) : 0;
    if (!made || PyModule_AddStringConstant(made, "digest", digest) || PyModule_AddStringConstant(made, "sources", sources))
        return 0;
    return made;
}
