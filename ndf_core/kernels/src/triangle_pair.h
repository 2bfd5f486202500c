/* Do two triangles of space properly intersect? By the signs of determinants only (Guigue, Devillers 2003).
 *
 * A determinant counts as zero when it is within the error bound of its evaluation, or when moving the corners by
 * `noise`, the rounding of the coordinates, could change its sign; and zero counts as touching. So common corners and
 * edges, contact within rounding and degenerate triangles (they have no interior) are never proper intersections;
 * crossing over a length, or overlapping over an area of a common plane, is. Corners with equal coordinates give
 * determinants of zero: neighbours need no special case. */
#ifndef NDF_TRIANGLE_PAIR_H
#define NDF_TRIANGLE_PAIR_H

#include <math.h>

/* Shewchuk's first-stage error bounds, (3 + 16e)e and (7 + 56e)e with e = 2^-53. */
#define BOUND_2D 3.3306690738754716e-16
#define BOUND_3D 7.771561172376103e-16

/* Sum of the magnitudes of the cross product's components. */
static double cross_size(const double *u, const double *v)
{
    return fabs(u[1] * v[2] - u[2] * v[1]) + fabs(u[2] * v[0] - u[0] * v[2]) + fabs(u[0] * v[1] - u[1] * v[0]);
}

/* Sign of the volume spanned by a - d, b - d, c - d. */
static int side_of_plane(const double *a, const double *b, const double *c, const double *d, double noise)
{
    double u[3], v[3], w[3], volume = 0.0, size = 0.0;
    for (int k = 0; k < 3; k++) { u[k] = a[k] - d[k]; v[k] = b[k] - d[k]; w[k] = c[k] - d[k]; }
    for (int x = 0; x < 3; x++) {
        int y = x < 2 ? x + 1 : 0, z = y < 2 ? y + 1 : 0;
        double left = v[y] * w[z], right = v[z] * w[y];
        volume += u[x] * (left - right);
        size += fabs(u[x]) * (fabs(left) + fabs(right));
    }
    double bound = BOUND_3D * size;
    if (fabs(volume) <= bound) return 0;
    /* The derivative by each corner is a cross product; that by d is minus the sum of the others. */
    bound += 2.0 * noise * (cross_size(u, v) + cross_size(v, w) + cross_size(w, u));
    return volume > bound ? 1 : volume < -bound ? -1 : 0;
}

static int side_of_line(const double *a, const double *b, const double *c, int x, int y, double noise)
{
    double left = (a[x] - c[x]) * (b[y] - c[y]), right = (a[y] - c[y]) * (b[x] - c[x]), area = left - right;
    double bound = BOUND_2D * (fabs(left) + fabs(right)) +
                   2.0 * noise * (fabs(a[x] - c[x]) + fabs(a[y] - c[y]) + fabs(b[x] - c[x]) + fabs(b[y] - c[y]));
    return area > bound ? 1 : area < -bound ? -1 : 0;
}

/* Is all of q outside, or on, one edge of p? */
static int edge_separates(const double *const *p, const double *const *q, int orientation, int x, int y,
                          double noise)
{
    for (int i = 0; i < 3; i++) {
        int j = 0;
        while (j < 3 && orientation * side_of_line(p[i], p[(i + 1) % 3], q[j], x, y, noise) <= 0) j++;
        if (j == 3) return 1;
    }
    return 0;
}

/* Coplanar triangles overlap unless a line through an edge has them on different sides. */
static int coplanar_overlap(const double *const *p, const double *const *q, double noise)
{
    double u[3], v[3], normal[3];
    for (int k = 0; k < 3; k++) { u[k] = p[1][k] - p[0][k]; v[k] = p[2][k] - p[0][k]; }
    for (int k = 0; k < 3; k++) normal[k] = fabs(u[(k + 1) % 3] * v[(k + 2) % 3] - u[(k + 2) % 3] * v[(k + 1) % 3]);
    int z = normal[1] > normal[0] ? 1 : 0;
    z = normal[2] > normal[z] ? 2 : z;
    int x = (z + 1) % 3, y = (z + 2) % 3;
    int p_turns = side_of_line(p[0], p[1], p[2], x, y, noise), q_turns = side_of_line(q[0], q[1], q[2], x, y, noise);
    return p_turns && q_turns && !edge_separates(p, q, p_turns, x, y, noise) &&
           !edge_separates(q, p, q_turns, x, y, noise);
}

/* The corner that is alone on its side of the other plane; -1 when the triangle does not reach both sides. */
static int lone_corner(const int *side)
{
    int positive = 0, negative = 0, corner = -1;
    for (int i = 0; i < 3; i++) { positive += side[i] > 0; negative += side[i] < 0; }
    if (!positive || !negative) return -1;
    for (int i = 0; i < 3; i++)
        if (side[i] == (positive == 1 ? 1 : -1)) corner = i;
    return corner;
}

/* Start at the corner; `flip` reverses the triangle. */
static void turn(const double *const *triangle, int corner, int flip, const double **turned)
{
    turned[0] = triangle[corner];
    turned[1] = triangle[(corner + (flip ? 2 : 1)) % 3];
    turned[2] = triangle[(corner + (flip ? 1 : 2)) % 3];
}

/* `noise`: how far rounding may have moved each coordinate. */
static int triangles_cross(const double *const *p, const double *const *q, double noise)
{
    int p_side[3], q_side[3];
    for (int i = 0; i < 3; i++) p_side[i] = side_of_plane(p[i], q[0], q[1], q[2], noise);
    if (!p_side[0] && !p_side[1] && !p_side[2]) return coplanar_overlap(p, q, noise);
    int p_lone = lone_corner(p_side);
    if (p_lone < 0) return 0;
    for (int i = 0; i < 3; i++) q_side[i] = side_of_plane(q[i], p[0], p[1], p[2], noise);
    int q_lone = lone_corner(q_side);
    if (q_lone < 0) return 0;
    /* Both reach across the line in which the planes meet. Turned so that both lone corners lie on positive sides, the
     * stretches of the line that they cover overlap when each begins before the other ends. */
    const double *a[3], *b[3];
    turn(p, p_lone, q_side[q_lone] < 0, a);
    turn(q, q_lone, p_side[p_lone] < 0, b);
    return side_of_plane(b[1], b[0], a[0], a[1], noise) < 0 &&
           side_of_plane(b[2], b[0], a[2], a[0], noise) < 0;
}

#endif
