/* What Numba's machine code calls by name for products and decompositions of matrices and for `reshape`. SciPy is
loaded by the first kernel that needs it. It follows boundary.c in one translation unit. */

int PyGILState_Ensure(void);
void PyGILState_Release(int), PyErr_Print(void);
Object *PyMapping_GetItemString(Object *, const char *);
const char *PyCapsule_GetName(Object *);
void abort(void);

enum { MOST_AXES = 64 };

void numba_gil_ensure(int *state) { *state = PyGILState_Ensure(); }

void numba_fatal_error(void) { abort(); }

/* A function of SciPy's, by the module and the name that Cython gives it; 0 with an exception. */
static void *of_scipy(void **kept, const char *module_name, const char *name) {
    if (!*kept) {
        int state = PyGILState_Ensure();
        Object *inner = PyImport_ImportModule(module_name);
        Object *table = inner ? PyObject_GetAttrString(inner, "__pyx_capi__") : 0;
        Object *capsule = table ? PyMapping_GetItemString(table, name) : 0;
        *kept = capsule ? PyCapsule_GetPointer(capsule, PyCapsule_GetName(capsule)) : 0;
        if (!*kept)
            PyErr_Print(); /* kernels cannot raise it: they end the program */
        PyGILState_Release(state);
    }
    return *kept;
}

int numba_xxdot(char kind, char conjugate, i64 n, void *x, void *y, double *result) {
    static void *kept;
    double (*dot)(int *, void *, int *, void *, int *) = of_scipy(&kept, "scipy.linalg.cython_blas", "ddot");
    int n_ = n, one = 1;
    if (!dot)
        return -1;
    *result = dot(&n_, x, &one, y, &one);
    return 0;
}

int numba_xxgemv(char kind, char trans, i64 m, i64 n, void *alpha, void *a, i64 lda, void *x, void *beta, void *y) {
    static void *kept;
    void (*gemv)(char *, int *, int *, void *, void *, int *, void *, int *, void *, void *, int *) =
        of_scipy(&kept, "scipy.linalg.cython_blas", "dgemv");
    int m_ = m, n_ = n, lda_ = lda, one = 1;
    if (!gemv)
        return -1;
    gemv(&trans, &m_, &n_, alpha, a, &lda_, x, &one, beta, y, &one);
    return 0;
}

int numba_xxgemm(char kind, char trans_a, char trans_b, i64 m, i64 n, i64 k, void *alpha, void *a, i64 lda, void *b,
    i64 ldb, void *beta, void *c, i64 ldc) {
    static void *kept;
    void (*gemm)(char *, char *, int *, int *, int *, void *, void *, int *, void *, int *, void *, void *, int *) =
        of_scipy(&kept, "scipy.linalg.cython_blas", "dgemm");
    int m_ = m, n_ = n, k_ = k, lda_ = lda, ldb_ = ldb, ldc_ = ldc;
    if (!gemm)
        return -1;
    gemm(&trans_a, &trans_b, &m_, &n_, &k_, alpha, a, &lda_, b, &ldb_, beta, c, &ldc_);
    return 0;
}

int numba_ez_gesdd(char kind, char job, i64 m, i64 n, void *a, i64 lda, void *s, void *u, i64 ldu, void *vt, i64 ldvt) {
    static void *kept;
    void (*gesdd)(char *, int *, int *, void *, int *, void *, void *, int *, void *, int *, void *, int *, int *, int *) =
        of_scipy(&kept, "scipy.linalg.cython_lapack", "dgesdd");
    int m_ = m, n_ = n, lda_ = lda, ldu_ = ldu, ldvt_ = ldvt, size = -1, unused, info = 0;
    double wanted = 0;
    if (!gesdd)
        return -1;
    gesdd(&job, &m_, &n_, a, &lda_, s, u, &ldu_, vt, &ldvt_, &wanted, &size, &unused, &info);
    if (info)
        return info;
    size = (int)wanted;
    double *work = malloc(size * sizeof(double));
    int *places = malloc(8 * (m < n ? m : n) * sizeof(int));
    if (work && places)
        gesdd(&job, &m_, &n_, a, &lda_, s, u, &ldu_, vt, &ldvt_, work, &size, places, &info);
    else
        info = -1;
    free(work);
    free(places);
    return info;
}

/* Strides of a new shape of the same memory; 0 if it must be copied. As NumPy's _attempt_nocopy_reshape. */
int numba_attempt_nocopy_reshape(i64 ndim, const i64 *shape, const i64 *strides, i64 new_ndim, const i64 *new_shape,
    i64 *new_strides, i64 itemsize, int is_fortran) {
    i64 old_shape[MOST_AXES], old_strides[MOST_AXES], size = 1, new_size = 1;
    int old_ndim = 0, begin = 0, end = 1, new_begin = 0, new_end = 1;
    for (int k = 0; k < ndim; k++)
        if (shape[k] != 1) {
            old_shape[old_ndim] = shape[k];
            old_strides[old_ndim++] = strides[k];
            size *= shape[k];
        }
    for (int k = 0; k < new_ndim; k++)
        new_size *= new_shape[k];
    if (size != new_size)
        return 0;
    if (size == 0) {
        for (int k = 0; k < new_ndim; k++)
            new_strides[k] = itemsize;
        return 1;
    }
    while (new_begin < new_ndim && begin < old_ndim) {
        size = old_shape[begin];
        new_size = new_shape[new_begin];
        while (size != new_size) {
            if (new_size < size)
                new_size *= new_shape[new_end++];
            else
                size *= old_shape[end++];
        }
        for (int k = begin; k < end - 1; k++)
            if (is_fortran ? old_strides[k + 1] != old_shape[k] * old_strides[k]
                           : old_strides[k] != old_shape[k + 1] * old_strides[k + 1])
                return 0;
        if (is_fortran) {
            new_strides[new_begin] = old_strides[begin];
            for (int k = new_begin + 1; k < new_end; k++)
                new_strides[k] = new_strides[k - 1] * new_shape[k - 1];
        } else {
            new_strides[new_end - 1] = old_strides[end - 1];
            for (int k = new_end - 1; k > new_begin; k--)
                new_strides[k - 1] = new_strides[k] * new_shape[k];
        }
        new_begin = new_end++;
        begin = end++;
    }
    i64 last = new_begin ? new_strides[new_begin - 1] * (is_fortran ? new_shape[new_begin - 1] : 1) : itemsize;
    for (int k = new_begin; k < new_ndim; k++)
        new_strides[k] = last;
    return 1;
}
