/* Field evaluation: interpolate position and features, encode, dense layers with ReLU, residual (paper Sec. 3.3).
 *
 * Samples run through the network in tiles of TILE, stored feature by feature ("structure of arrays"), so that every
 * loop's innermost index is the sample: the encoding vectorises over samples, and a dense layer is a block of rows
 * of the weight matrix held in registers against a few vectors of samples. A row's result does not depend on its
 * place in the tile, so answers are the same for every batch size and every split over threads.
 */
#include "arrays.h"
#include <math.h>
#include <stdlib.h>

#define TILE 64
#define MAX_LAYERS 64
#define MAX_WIDTH 65536

#if defined(__clang__)
#pragma STDC FP_CONTRACT ON
#elif defined(__GNUC__)
#pragma GCC optimize("fp-contract=fast") /* fused multiply-add, which -std=c11 turns off; half of the peak otherwise */
#endif

#if defined(__GNUC__)
#define UNROLL _Pragma("GCC unroll 16")
#else
#define UNROLL
#endif

#define BLOCK 8 /* rows of a weight matrix that are packed together */

typedef struct {
    Py_ssize_t layers, levels, width[MAX_LAYERS + 1];
    const float *packed; /* layer after layer: biases (padded to BLOCK), then weights as [row block][input][BLOCK] */
    const float *features;
    Py_ssize_t feature_dim, widest;
    double base_frequency;
    int include_position, residual, most;
} Network;

typedef struct {
    const double *vertices;
    const int32_t *base_faces;
    const int32_t *faces;
    const double *barycentric;
    const double *points; /* instead of the four above, for a field over space */
} Queries;

static Py_ssize_t padded(Py_ssize_t rows) { return (rows + BLOCK - 1) / BLOCK * BLOCK; }

#if defined(__GNUC__) && defined(__x86_64__)
#define NAME(x) x##_avx512
#define TARGET __attribute__((target("avx512f,avx512dq,avx512vl,fma")))
#define VECTOR_BYTES 64
#define ROWS 8
#define VECTORS 2
#include "field_tile.h"
#define NAME(x) x##_avx2
#define TARGET __attribute__((target("avx2,fma")))
#define VECTOR_BYTES 32
#define ROWS 4
#define VECTORS 2
#include "field_tile.h"
#endif
#define NAME(x) x##_any
#define TARGET
#if defined(__GNUC__)
#define VECTOR_BYTES 16
#define ROWS 2
#define VECTORS 4
#else
#define VECTOR_BYTES 4
#define ROWS 4
#define VECTORS 2
#endif
#include "field_tile.h"

/* `most` keeps to lesser instruction sets, so that each can be tested: 1 to AVX2, 0 to what every processor has. */
static void run(const Network *net, const Queries *queries, Py_ssize_t count, float *answer, float *scratch, int most)
{
#if defined(__GNUC__) && defined(__x86_64__)
    if (most > 1 && __builtin_cpu_supports("avx512f") && __builtin_cpu_supports("avx512dq")
        && __builtin_cpu_supports("avx512vl"))
        run_avx512(net, queries, count, answer, scratch);
    else if (most > 0 && __builtin_cpu_supports("avx2") && __builtin_cpu_supports("fma"))
        run_avx2(net, queries, count, answer, scratch);
    else
#endif
        run_any(net, queries, count, answer, scratch);
}

/* Fill the network's sizes from `widths`. Returns the number of floats of the packed form, or -1 with an error set. */
static Py_ssize_t set_sizes(Network *net, const Array *widths, const Array *parameters, const Array *features)
{
    const int32_t *width = widths->data;
    net->layers = widths->rows - 1;
    if (net->layers < 1 || net->layers > MAX_LAYERS) {
        PyErr_Format(PyExc_ValueError, "need 1 to %d layers, got %zd", MAX_LAYERS, net->layers);
        return -1;
    }
    Py_ssize_t plain = 0, packed = 0;
    net->widest = 0;
    for (Py_ssize_t i = 0; i <= net->layers; i++) {
        if (width[i] < 1 || width[i] > MAX_WIDTH) {
            PyErr_Format(PyExc_ValueError, "layer widths must be 1 to %d, got %d", MAX_WIDTH, width[i]);
            return -1;
        }
        net->width[i] = width[i];
        if (padded(width[i]) > net->widest)
            net->widest = padded(width[i]);
        if (i) {
            plain += (Py_ssize_t)width[i] * (1 + width[i - 1]);
            packed += padded(width[i]) * (1 + width[i - 1]);
        }
    }
    Py_ssize_t inputs = 3 * net->include_position + 6 * net->levels + features->columns;
    if (net->levels < 0 || net->levels > MAX_WIDTH || inputs != width[0]) {
        PyErr_Format(PyExc_ValueError, "encoding and features give %zd inputs, the network takes %d", inputs, width[0]);
        return -1;
    }
    if (net->residual && width[net->layers] != 3) {
        PyErr_Format(PyExc_ValueError, "a residual network has 3 outputs, got %d", width[net->layers]);
        return -1;
    }
    if (plain != parameters->rows) {
        PyErr_Format(PyExc_ValueError, "the layers need %zd parameters, got %zd", plain, parameters->rows);
        return -1;
    }
    return packed;
}

/* From row-major weights followed by biases, layer after layer, to `Network.packed`. */
static void pack(const Network *net, const float *plain, float *packed)
{
    for (Py_ssize_t i = 0; i < net->layers; i++) {
        Py_ssize_t inputs = net->width[i], outputs = net->width[i + 1], rows = padded(outputs);
        for (Py_ssize_t o = 0; o < rows; o++)
            *packed++ = o < outputs ? plain[outputs * inputs + o] : 0.0f;
        for (Py_ssize_t o = 0; o < rows; o += BLOCK)
            for (Py_ssize_t j = 0; j < inputs; j++)
                for (Py_ssize_t r = o; r < o + BLOCK; r++)
                    *packed++ = r < outputs ? plain[r * inputs + j] : 0.0f;
        plain += outputs * (1 + inputs);
    }
}

static int indices_below(const int32_t *indices, Py_ssize_t count, Py_ssize_t limit, const char *name)
{
    for (Py_ssize_t i = 0; i < count; i++)
        if (indices[i] < 0 || indices[i] >= limit) {
            PyErr_Format(PyExc_IndexError, "%s: index %d is outside [0, %zd)", name, indices[i], limit);
            return 0;
        }
    return 1;
}

static PyObject *evaluate_network(Network *net, Queries *queries, Py_ssize_t count, const Array *answer,
                                  const Array *widths, const Array *parameters, const Array *features)
{
    Py_ssize_t size = set_sizes(net, widths, parameters, features);
    if (size < 0)
        return NULL;
    if (answer->rows != count || answer->columns != net->width[net->layers]) {
        PyErr_SetString(PyExc_ValueError, "answer: wrong shape");
        return NULL;
    }
    void *memory = malloc(sizeof(float) * (size_t)(size + 2 * net->widest * TILE) + 64);
    if (!memory)
        return PyErr_NoMemory();
    float *scratch = (float *)(((uintptr_t)memory + 63) / 64 * 64); /* first: its vectors must be aligned */
    float *packed = scratch + 2 * net->widest * TILE;
    net->packed = packed;
    Py_BEGIN_ALLOW_THREADS
    pack(net, parameters->data, packed);
    run(net, queries, count, answer->data, scratch, net->most);
    Py_END_ALLOW_THREADS
    free(memory);
    Py_RETURN_NONE;
}

/* evaluate(answer f(n,k), faces i(n,), barycentric d(n,3), vertices d(v,3), base_faces i(f,3), features f(v,d),
 *          widths i(layers+1,), parameters f(p,), base_frequency, levels, include_position, residual, most) */
static PyObject *evaluate(PyObject *self, PyObject *args)
{
    PyObject *objects[8], *result = NULL;
    Network net = {0};
    int levels;
    if (!PyArg_ParseTuple(args, "OOOOOOOOdippi", &objects[0], &objects[1], &objects[2], &objects[3], &objects[4],
                          &objects[5], &objects[6], &objects[7], &net.base_frequency, &levels, &net.include_position,
                          &net.residual, &net.most))
        return NULL;
    net.levels = levels;
    static const char formats[] = "fiddifif", *const names[] = {"answer", "faces", "barycentric", "vertices",
                                                                "base_faces", "features", "widths", "parameters"};
    static const int columns[] = {-1, 1, 3, 3, 3, -1, 1, 1};
    Array arrays[8];
    int held = 0;
    while (held < 8) {
        if (array_get(objects[held], &arrays[held], formats[held], columns[held], held == 0, names[held]) < 0)
            goto done;
        held++;
    }
    Queries queries = {arrays[3].data, arrays[4].data, arrays[1].data, arrays[2].data, NULL};
    Py_ssize_t count = arrays[1].rows;
    if (arrays[2].rows != count || arrays[5].rows != arrays[3].rows) {
        PyErr_SetString(PyExc_ValueError, "barycentric needs a row per face, features a row per vertex");
        goto done;
    }
    if (!indices_below(arrays[4].data, 3 * arrays[4].rows, arrays[3].rows, "base_faces")
        || !indices_below(arrays[1].data, count, arrays[4].rows, "faces"))
        goto done;
    net.features = arrays[5].data;
    net.feature_dim = arrays[5].columns;
    result = evaluate_network(&net, &queries, count, &arrays[0], &arrays[6], &arrays[7], &arrays[5]);
done:
    while (held--)
        array_release(&arrays[held]);
    return result;
}

/* evaluate_space(answer f(n,k), points d(n,3), widths, parameters, base_frequency, levels, include_position, residual,
 *                most) */
static PyObject *evaluate_space(PyObject *self, PyObject *args)
{
    PyObject *objects[4], *result = NULL;
    Network net = {0};
    int levels;
    if (!PyArg_ParseTuple(args, "OOOOdippi", &objects[0], &objects[1], &objects[2], &objects[3], &net.base_frequency,
                          &levels, &net.include_position, &net.residual, &net.most))
        return NULL;
    net.levels = levels;
    static const char formats[] = "fdif", *const names[] = {"answer", "points", "widths", "parameters"};
    static const int columns[] = {-1, 3, 1, 1};
    Array arrays[4], no_features = {.columns = 0};
    int held = 0;
    while (held < 4) {
        if (array_get(objects[held], &arrays[held], formats[held], columns[held], held == 0, names[held]) < 0)
            goto done;
        held++;
    }
    Queries queries = {.points = arrays[1].data};
    result = evaluate_network(&net, &queries, arrays[1].rows, &arrays[0], &arrays[2], &arrays[3], &no_features);
done:
    while (held--)
        array_release(&arrays[held]);
    return result;
}

static PyMethodDef methods[] = {
    {"evaluate", evaluate, METH_VARARGS, "Evaluate a field over the base mesh."},
    {"evaluate_space", evaluate_space, METH_VARARGS, "Evaluate a field over space."},
    {NULL, NULL, 0, NULL},
};
static struct PyModuleDef module = {PyModuleDef_HEAD_INIT, "_field", NULL, 0, methods, NULL, NULL, NULL, NULL};
PyMODINIT_FUNC PyInit__field(void) { return PyModule_Create(&module); }
