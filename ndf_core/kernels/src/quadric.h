/* Error quadrics E(p) = p'Ap - 2 b'p + c (Garland and Heckbert 1997), with an isotropic part.
 *
 * One triangle gives area * ((n.(p - v))^2 + s^2 * mean |p - y|^2 over y in the triangle). The first term is the squared
 * distance from its plane; the second pulls p towards the centroid of the patch that a vertex stands for (the energy of
 * centroidal Voronoi diagrams), which makes flat regions even and A positive definite. The same sum comes out of planes
 * with Gaussian noise s on their normals (Trettner and Kobbelt 2020). */
#ifndef NDF_QUADRIC_H
#define NDF_QUADRIC_H

#include <math.h>

typedef struct { double xx, xy, xz, yy, yz, zz, x, y, z, c; } Quadric;

static inline void subtract(const double a[3], const double b[3], double out[3])
{
    for (int i = 0; i < 3; i++) out[i] = a[i] - b[i];
}

static inline void cross(const double a[3], const double b[3], double out[3])
{
    out[0] = a[1] * b[2] - a[2] * b[1];
    out[1] = a[2] * b[0] - a[0] * b[2];
    out[2] = a[0] * b[1] - a[1] * b[0];
}

static inline double dot(const double a[3], const double b[3]) { return a[0] * b[0] + a[1] * b[1] + a[2] * b[2]; }

static inline void quadric_add(Quadric *q, const Quadric *other)
{
    double *into = (double *)q;
    const double *from = (const double *)other;
    for (int i = 0; i < 10; i++) into[i] += from[i];
}

/* weight * (n.(p - v))^2 for a unit normal n. */
static inline void quadric_add_plane(Quadric *q, const double n[3], const double v[3], double weight)
{
    double d = dot(n, v);
    q->xx += weight * n[0] * n[0]; q->xy += weight * n[0] * n[1]; q->xz += weight * n[0] * n[2];
    q->yy += weight * n[1] * n[1]; q->yz += weight * n[1] * n[2]; q->zz += weight * n[2] * n[2];
    q->x += weight * d * n[0]; q->y += weight * d * n[1]; q->z += weight * d * n[2];
    q->c += weight * d * d;
}

/* weight * mean |p - y|^2 over the triangle (a, b, c); the mean of |y|^2 is (9 |m|^2 + |a|^2 + |b|^2 + |c|^2) / 12. */
static inline void quadric_add_patch(Quadric *q, const double a[3], const double b[3], const double c[3], double weight)
{
    double m[3];
    for (int i = 0; i < 3; i++) m[i] = (a[i] + b[i] + c[i]) / 3;
    q->xx += weight; q->yy += weight; q->zz += weight;
    q->x += weight * m[0]; q->y += weight * m[1]; q->z += weight * m[2];
    q->c += weight * (9 * dot(m, m) + dot(a, a) + dot(b, b) + dot(c, c)) / 12;
}

static inline double quadric_value(const Quadric *q, const double p[3])
{
    double x = q->xx * p[0] + q->xy * p[1] + q->xz * p[2];
    double y = q->xy * p[0] + q->yy * p[1] + q->yz * p[2];
    double z = q->xz * p[0] + q->yz * p[1] + q->zz * p[2];
    double value = p[0] * (x - 2 * q->x) + p[1] * (y - 2 * q->y) + p[2] * (z - 2 * q->z) + q->c;
    return value > 0 ? value : 0;
}

/* The minimiser of E, found from the start p (for precision) and written over it. Returns 0 when A is close to singular. */
static inline int quadric_minimise(const Quadric *q, double p[3])
{
    double trace = q->xx + q->yy + q->zz;
    double r[3] = {q->x - (q->xx * p[0] + q->xy * p[1] + q->xz * p[2]), q->y - (q->xy * p[0] + q->yy * p[1] + q->yz * p[2]),
                   q->z - (q->xz * p[0] + q->yz * p[1] + q->zz * p[2])};
    double c00 = q->yy * q->zz - q->yz * q->yz, c01 = q->xz * q->yz - q->xy * q->zz, c02 = q->xy * q->yz - q->xz * q->yy;
    double c11 = q->xx * q->zz - q->xz * q->xz, c12 = q->xy * q->xz - q->xx * q->yz, c22 = q->xx * q->yy - q->xy * q->xy;
    double determinant = q->xx * c00 + q->xy * c01 + q->xz * c02;
    if (!(determinant > 1e-13 * trace * trace * trace)) return 0;
    p[0] += (c00 * r[0] + c01 * r[1] + c02 * r[2]) / determinant;
    p[1] += (c01 * r[0] + c11 * r[1] + c12 * r[2]) / determinant;
    p[2] += (c02 * r[0] + c12 * r[1] + c22 * r[2]) / determinant;
    return 1;
}

#endif
