/* Edge flips towards an extrinsic Delaunay mesh. An edge is flipped only where it may be without leaving the base
 * mesh: inside one base face, in a quadrilateral that is strictly convex there. So the map stays a bijection. */
#ifndef NDF_FLIPS_H
#define NDF_FLIPS_H

static double orientation(const double *a, const double *b, const double *c)
{
    /* exact for weights with up to 26 binary places: their products fit a double */
    return (b[1] - a[1]) * (c[2] - a[2]) - (b[2] - a[2]) * (c[1] - a[1]);
}

static void area_normal(const double *points, int32_t a, int32_t b, int32_t c, double *normal)
{
    const double *p = points + 3 * (Py_ssize_t)a, *q = points + 3 * (Py_ssize_t)b, *r = points + 3 * (Py_ssize_t)c;
    double u[3], v[3];
    for (int k = 0; k < 3; k++) {
        u[k] = q[k] - p[k];
        v[k] = r[k] - p[k];
    }
    for (int k = 0; k < 3; k++)
        normal[k] = u[(k + 1) % 3] * v[(k + 2) % 3] - u[(k + 2) % 3] * v[(k + 1) % 3];
}

static double dot(const double *a, const double *b) { return a[0] * b[0] + a[1] * b[1] + a[2] * b[2]; }

/* Cotangent of the angle at `apex` between `a` and `b`; `normal` is the triangle's area vector. */
static double cotangent(const double *points, int32_t apex, int32_t a, int32_t b, const double *normal)
{
    const double *o = points + 3 * (Py_ssize_t)apex, *p = points + 3 * (Py_ssize_t)a, *q = points + 3 * (Py_ssize_t)b;
    double product = 0.0;
    for (int k = 0; k < 3; k++)
        product += (p[k] - o[k]) * (q[k] - o[k]);
    return product / fmax(sqrt(dot(normal, normal)), 1e-300);
}

/* Whether edge a b of the faces (a, b, c) and (b, a, d), nearly coplanar, should become c d. */
static int improves(const double *mapped, int32_t a, int32_t b, int32_t c, int32_t d, double limit)
{
    double left[3], right[3], first[3], second[3];
    area_normal(mapped, a, b, c, left);
    area_normal(mapped, b, a, d, right);
    double before = cotangent(mapped, c, a, b, left) + cotangent(mapped, d, a, b, right);
    if (!(before < -1e-6))
        return 0;
    double length = squared_distance(mapped, c, d);
    if (length > limit * limit && length > squared_distance(mapped, a, b))
        return 0;
    if (dot(left, right) < 0.5 * sqrt(dot(left, left) * dot(right, right)))
        return 0; /* a crease: flipping would cut it off */
    area_normal(mapped, a, d, c, first);
    area_normal(mapped, d, b, c, second);
    double sum[3] = {left[0] + right[0], left[1] + right[1], left[2] + right[2]};
    if (!(dot(first, sum) > 0 && dot(second, sum) > 0))
        return 0;
    return cotangent(mapped, a, c, d, first) + cotangent(mapped, b, c, d, second) > before;
}

static void set_twin(int32_t *twins, Py_ssize_t half_edge, int32_t twin)
{
    twins[half_edge] = twin;
    if (twin >= 0)
        twins[twin] = (int32_t)half_edge;
}

/* Faces (a, b, c) and (b, a, d) become (a, d, c) and (d, b, c). */
static void flip(int32_t *corners, int32_t *twins, Py_ssize_t h)
{
    Py_ssize_t g = twins[h], f0 = h / 3 * 3, g0 = g / 3 * 3;
    int i = (int)(h - f0), j = (int)(g - g0);
    int32_t a = corners[h], b = corners[g], c = corners[f0 + (i + 2) % 3], d = corners[g0 + (j + 2) % 3];
    int32_t bc = twins[f0 + (i + 1) % 3], ca = twins[f0 + (i + 2) % 3];
    int32_t ad = twins[g0 + (j + 1) % 3], db = twins[g0 + (j + 2) % 3];
    const int32_t one[3] = {a, d, c}, two[3] = {d, b, c};
    memcpy(corners + f0, one, sizeof one);
    memcpy(corners + g0, two, sizeof two);
    set_twin(twins, f0, ad);
    set_twin(twins, f0 + 1, (int32_t)(g0 + 2));
    set_twin(twins, f0 + 2, ca);
    set_twin(twins, g0, db);
    set_twin(twins, g0 + 1, bc);
}

/* One sweep over all edges; returns the number of flips. */
static Py_ssize_t flip_sweep(int32_t *corners, int32_t *twins, const int32_t *home, Py_ssize_t faces,
                             const double *mapped, const Points *points, double limit)
{
    Py_ssize_t flips = 0;
    for (Py_ssize_t h = 0; h < 3 * faces; h++) {
        Py_ssize_t g = twins[h];
        if (g < h || home[h / 3] != home[g / 3]) /* g = -1 at a boundary */
            continue;
        int32_t quad[4] = {corners[h], corners[g], corners[h / 3 * 3 + (h % 3 + 2) % 3],
                           corners[g / 3 * 3 + (g % 3 + 2) % 3]};
        if (!improves(mapped, quad[0], quad[1], quad[2], quad[3], limit))
            continue;
        double weights[4][3];
        for (int k = 0; k < 4; k++)
            corner_weights(points, home[h / 3], quad[k], weights[k]);
        if (orientation(weights[0], weights[3], weights[2]) > 0 && orientation(weights[3], weights[1], weights[2]) > 0) {
            flip(corners, twins, h);
            flips++;
        }
    }
    return flips;
}

#endif
