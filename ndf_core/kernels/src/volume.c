/* Value and gradient of a separable interpolant of a volume, from four coefficients along each axis. */
#include "arrays.h"

#include <math.h>

enum { LINEAR, CATMULL_ROM, B_SPLINE, KINDS };

/* Weights of the four coefficients about a cell, and their derivatives, at 0 <= t <= 1 between the middle two. */
static void weights(int kind, double t, double w[4], double d[4])
{
    double s = 1 - t;
    switch (kind) {
    case LINEAR:
        w[0] = w[3] = d[0] = d[3] = 0;
        w[1] = s, w[2] = t;
        d[1] = -1, d[2] = 1;
        break;
    case CATMULL_ROM:
        w[0] = -0.5 * t * s * s, w[3] = -0.5 * t * t * s;
        w[1] = 1 + t * t * (1.5 * t - 2.5), w[2] = 1 + s * s * (1.5 * s - 2.5);
        d[0] = -0.5 * s * (s - 2 * t), d[3] = -0.5 * t * (2 * s - t);
        d[1] = t * (4.5 * t - 5), d[2] = -s * (4.5 * s - 5);
        break;
    default:
        w[0] = s * s * s / 6, w[3] = t * t * t / 6;
        w[1] = 2.0 / 3 + t * t * (0.5 * t - 1), w[2] = 2.0 / 3 + s * s * (0.5 * s - 1);
        d[0] = -0.5 * s * s, d[3] = 0.5 * t * t;
        d[1] = t * (1.5 * t - 2), d[2] = -s * (1.5 * s - 2);
    }
}

/* One point. `c` has one coefficient more than voxels on each side; beyond the voxels the interpolant goes on along
 * its tangent. */
static double at(const float *c, const Py_ssize_t n[3], int kind, const double p[3], double gradient[3])
{
    double w[3][4], d[3][4], beyond[3];
    Py_ssize_t first[3];
    for (int k = 0; k < 3; k++) {
        double inside = fmin(fmax(p[k], 0), (double)(n[k] - 1));
        Py_ssize_t cell = (Py_ssize_t)inside;
        if (cell > n[k] - 2)
            cell = n[k] - 2;
        first[k] = cell;
        beyond[k] = p[k] - inside;
        weights(kind, inside - (double)cell, w[k], d[k]);
    }
    Py_ssize_t row = n[2] + 2, slab = (n[1] + 2) * row;
    double value = 0, gx = 0, gy = 0, gz = 0;
    for (int i = 0; i < 4; i++) {
        double plane = 0, plane_y = 0, plane_z = 0;
        for (int j = 0; j < 4; j++) {
            const float *line = c + (first[0] + i) * slab + (first[1] + j) * row + first[2];
            double v = w[2][0] * line[0] + w[2][1] * line[1] + w[2][2] * line[2] + w[2][3] * line[3];
            double v_z = d[2][0] * line[0] + d[2][1] * line[1] + d[2][2] * line[2] + d[2][3] * line[3];
            plane += w[1][j] * v, plane_y += d[1][j] * v, plane_z += w[1][j] * v_z;
        }
        value += w[0][i] * plane, gx += d[0][i] * plane, gy += w[0][i] * plane_y, gz += w[0][i] * plane_z;
    }
    gradient[0] = gx, gradient[1] = gy, gradient[2] = gz;
    return value + gx * beyond[0] + gy * beyond[1] + gz * beyond[2];
}

/* sample(values d(n,), gradients d(n,3), points d(n,3), coefficients f(all,), x, y, z, kind): points in voxels. */
static PyObject *sample(PyObject *self, PyObject *args)
{
    PyObject *o[4], *result = NULL;
    Py_ssize_t n[3];
    int kind;
    Arrays a;
    static const int columns[] = {1, 3, 3, 1};
    if (!PyArg_ParseTuple(args, "OOOOnnni", &o[0], &o[1], &o[2], &o[3], &n[0], &n[1], &n[2], &kind)
        || arrays_get(&a, o, "dddf", columns, NULL, 2) < 0)
        return NULL;
    Array *x = a.array;
    const Py_ssize_t most = 1 << 20;
    int sized = n[0] >= 2 && n[1] >= 2 && n[2] >= 2 && n[0] < most && n[1] < most && n[2] < most;
    if (!sized || (n[0] + 2) * (n[1] + 2) > PY_SSIZE_T_MAX / (n[2] + 2)
        || x[3].rows != (n[0] + 2) * (n[1] + 2) * (n[2] + 2) || kind < 0 || kind >= KINDS
        || x[0].rows != x[2].rows || x[1].rows != x[2].rows) {
        PyErr_SetString(PyExc_ValueError, "sample: sizes do not fit, or the kind is unknown");
    } else {
        const double *points = x[2].data;
        double *values = x[0].data, *gradients = x[1].data;
        Py_ssize_t bad = -1;
        Py_BEGIN_ALLOW_THREADS
        for (Py_ssize_t i = 0; i < x[2].rows && bad < 0; i++) {
            const double *p = points + 3 * i;
            if (isfinite(p[0]) && isfinite(p[1]) && isfinite(p[2]))
                values[i] = at(x[3].data, n, kind, p, gradients + 3 * i);
            else
                bad = i;
        }
        Py_END_ALLOW_THREADS
        if (bad >= 0)
            PyErr_Format(PyExc_ValueError, "points: row %zd is not finite", bad);
        else
            result = Py_NewRef(Py_None);
    }
    arrays_release(&a);
    return result;
}

static PyMethodDef methods[] = {
    {"sample", sample, METH_VARARGS, "Value and gradient of an interpolated volume."},
    {NULL, NULL, 0, NULL},
};
static struct PyModuleDef module = {PyModuleDef_HEAD_INIT, "_volume", NULL, 0, methods, NULL, NULL, NULL, NULL};
PyMODINIT_FUNC PyInit__volume(void) { return PyModule_Create(&module); }
