/* Typed views of contiguous numpy arrays through the buffer protocol, within the limited API (CPython >= 3.11). */
#ifndef NDF_ARRAYS_H
#define NDF_ARRAYS_H

#include <Python.h>
#include <stdint.h>
#include <string.h>

typedef struct {
    Py_buffer view;
    void *data;
    Py_ssize_t rows;    /* shape[0], or the length of a flat array */
    Py_ssize_t columns; /* product of the other dimensions, 1 for a flat array */
} Array;

/* Fill `array` from `object`, which must be C-contiguous with the given item format: 'd' float64, 'f' float32,
 * 'i' int32, 'q' int64, 'b' int8, 'B' uint8. `columns` < 0 accepts any. Returns 0, or -1 with a Python error set. */
static int array_get(PyObject *object, Array *array, char format, Py_ssize_t columns, int writable, const char *name)
{
    int flags = PyBUF_C_CONTIGUOUS | PyBUF_FORMAT | (writable ? PyBUF_WRITABLE : 0);
    if (PyObject_GetBuffer(object, &array->view, flags) < 0)
        return -1;
    const char *have = array->view.format ? array->view.format : "B";
    if (*have == '<' || *have == '=' || *have == '@')
        have++;
    char kind = *have;
    if (kind == 'l' && array->view.itemsize == 8) kind = 'q';
    if (kind == 'l' && array->view.itemsize == 4) kind = 'i';
    Py_ssize_t rows = array->view.ndim ? array->view.shape[0] : 1, rest = 1;
    for (int i = 1; i < array->view.ndim; i++)
        rest *= array->view.shape[i];
    if (kind != format || (columns >= 0 && rest != columns)) {
        PyErr_Format(PyExc_ValueError, "%s: need a contiguous array of format '%c' with %zd columns, got '%s' with %zd",
                     name, format, columns, array->view.format ? array->view.format : "B", rest);
        PyBuffer_Release(&array->view);
        return -1;
    }
    array->data = array->view.buf;
    array->rows = rows;
    array->columns = rest;
    return 0;
}

static inline void array_release(Array *array) { PyBuffer_Release(&array->view); }

typedef struct {
    Array array[10];
    int held;
} Arrays;

static inline void arrays_release(Arrays *arrays)
{
    while (arrays->held)
        array_release(&arrays->array[--arrays->held]);
}

/* Fill one array per character of `formats` from `objects`, all or none; the first `writable` of them for writing.
 * `names` are for messages; NULL says "argument 1" and so on. Returns 0, or -1 with a Python error set. */
static inline int arrays_get(Arrays *arrays, PyObject **objects, const char *formats, const int *columns,
                             const char *const *names, int writable)
{
    arrays->held = 0;
    for (int i = 0; formats[i]; i++) {
        char number[16];
        PyOS_snprintf(number, sizeof number, "argument %d", i + 1);
        if (array_get(objects[i], &arrays->array[i], formats[i], columns[i], i < writable, names ? names[i] : number) < 0) {
            arrays_release(arrays);
            return -1;
        }
        arrays->held++;
    }
    return 0;
}

#endif
