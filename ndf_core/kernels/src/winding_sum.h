/* One query through the tree: the winding number and, where asked for, its gradient. */
#ifndef NDF_WINDING_SUM_H
#define NDF_WINDING_SUM_H

#include "winding_tree.h"

#define OVER_4_PI 0.07957747154594767

typedef struct {
    float value[LANES], gradient[3][LANES]; /* times 4 pi; the gradient with respect to sources minus query */
} Sums;

/* Children that are far enough add their moments; the mask says which are not. */
INLINE void add_children(const Node *node, const float *q, Sums *sums, int32_t *near, const int with_gradient)
{
    for (int i = 0; i < LANES; i++) {
        float rx = node->center[0][i] - q[0], ry = node->center[1][i] - q[1], rz = node->center[2][i] - q[2];
        float squared = rx * rx + ry * ry + rz * rz;
        int far = squared > node->beyond[i];
        near[i] = !far;
        float over = far ? 1.0f / squared : 0.0f, root = sqrtf(over);
        float x = rx * root, y = ry * root, z = rz * root;
        float xx = x * x - z * z, yy = y * y - z * z, xy = 2 * x * y, xz = 2 * x * z, yz = 2 * y * z;
        const float(*a)[LANES] = node->m1, (*b)[LANES] = node->m2, (*c)[LANES] = node->m3;
        float s1 = a[0][i] * x + a[1][i] * y + a[2][i] * z;
        float bx = b[0][i] * x + b[2][i] * y + b[3][i] * z;
        float by = b[2][i] * x + b[1][i] * y + b[4][i] * z;
        float bz = b[3][i] * x + b[4][i] * y - (b[0][i] + b[1][i]) * z;
        float s2 = bx * x + by * y + bz * z;
        float xzz = -(c[0][i] + c[3][i]), yzz = -(c[1][i] + c[2][i]);
        float cx = c[0][i] * xx + c[3][i] * yy + c[2][i] * xy + c[4][i] * xz + c[6][i] * yz;
        float cy = c[2][i] * xx + c[1][i] * yy + c[3][i] * xy + c[6][i] * xz + c[5][i] * yz;
        float cz = c[4][i] * xx + c[5][i] * yy + c[6][i] * xy + xzz * xz + yzz * yz;
        float s3 = cx * x + cy * y + cz * z;
        sums->value[i] += over * (s1 + root * (15 * root * s3 - 3 * s2));
        if (with_gradient) {
            float cube = over * root;
            float along = -3 * s1 + root * (15 * s2 - 105 * root * s3);
            sums->gradient[0][i] += cube * (a[0][i] + along * x + root * (45 * root * cx - 6 * bx));
            sums->gradient[1][i] += cube * (a[1][i] + along * y + root * (45 * root * cy - 6 * by));
            sums->gradient[2][i] += cube * (a[2][i] + along * z + root * (45 * root * cz - 6 * bz));
        }
    }
}

/* A dipole spread over a ball of radius R with density 1 - (r / R)^2: the dipole itself outside, smooth inside. */
INLINE void add_points(const Leaf *leaf, const float *q, Sums *sums, const int with_gradient)
{
    for (int i = 0; i < LANES; i++) {
        float rx = leaf->a[0][i] - q[0], ry = leaf->a[1][i] - q[1], rz = leaf->a[2][i] - q[2];
        float squared = rx * rx + ry * ry + rz * rz, ball = leaf->radius[i] * leaf->radius[i];
        int inside = squared < ball;
        float over = 1.0f / (inside ? ball : squared), cube = over * sqrtf(over);
        float factor = inside ? cube * (2.5f - 1.5f * squared * over) : cube;
        float s = leaf->area[0][i] * rx + leaf->area[1][i] * ry + leaf->area[2][i] * rz;
        sums->value[i] += s * factor;
        if (with_gradient) {
            float along = -3 * s * cube * over;
            sums->gradient[0][i] += leaf->area[0][i] * factor + along * rx;
            sums->gradient[1][i] += leaf->area[1][i] * factor + along * ry;
            sums->gradient[2][i] += leaf->area[2][i] * factor + along * rz;
        }
    }
}

/* atan2 within 2e-7; 0 for y = 0 whatever x is, the mean of both sides of the cut (polynomial: Cephes, S. Moshier). */
INLINE float angle_of(float y, float x)
{
    float ax = fabsf(x), ay = fabsf(y);
    float large = ax > ay ? ax : ay, small = ax > ay ? ay : ax;
    float t = large > 0 ? small / large : 0;
    int upper = t > 0.4142135624f;
    float s = upper ? (t - 1) / (t + 1) : t, z = s * s;
    float angle = (((8.05374449538e-2f * z - 1.38776856032e-1f) * z + 1.99777106478e-1f) * z - 3.33329491539e-1f) * z * s + s;
    angle += upper ? 0.7853981634f : 0;
    angle = ay > ax ? 1.5707963268f - angle : angle;
    angle = x < 0 ? 3.1415926536f - angle : angle;
    return y == 0 ? 0 : y < 0 ? -angle : angle;
}

INLINE float edge_term(float dot, float one, float other)
{
    float product = one * other, below = product * (product + dot);
    return below > 1e-30f ? (one + other) / below : 0; /* on the edge itself the gradient is infinite */
}

/* Solid angles (van Oosterom and Strackee 1983); their gradient is Biot and Savart's law on the three edges. */
INLINE void add_triangles(const Leaf *leaf, const float *q, Sums *sums, const int with_gradient)
{
    for (int i = 0; i < LANES; i++) {
        float ax = leaf->a[0][i] - q[0], ay = leaf->a[1][i] - q[1], az = leaf->a[2][i] - q[2];
        float bx = leaf->b[0][i] - q[0], by = leaf->b[1][i] - q[1], bz = leaf->b[2][i] - q[2];
        float cx = leaf->c[0][i] - q[0], cy = leaf->c[1][i] - q[1], cz = leaf->c[2][i] - q[2];
        float la = sqrtf(ax * ax + ay * ay + az * az), lb = sqrtf(bx * bx + by * by + bz * bz);
        float lc = sqrtf(cx * cx + cy * cy + cz * cz);
        float ab = ax * bx + ay * by + az * bz, bc = bx * cx + by * cy + bz * cz, ca = cx * ax + cy * ay + cz * az;
        float above = leaf->area[0][i] * ax + leaf->area[1][i] * ay + leaf->area[2][i] * az;
        float angle = 2 * angle_of(above, la * lb * lc + ab * lc + bc * la + ca * lb);
        sums->value[i] += angle;
        if (with_gradient) {
            int real = leaf->area[0][i] != 0 || leaf->area[1][i] != 0 || leaf->area[2][i] != 0;
            float e = real ? edge_term(ab, la, lb) : 0, f = real ? edge_term(bc, lb, lc) : 0;
            float g = real ? edge_term(ca, lc, la) : 0;
            sums->gradient[0][i] -= e * (ay * bz - az * by) + f * (by * cz - bz * cy) + g * (cy * az - cz * ay);
            sums->gradient[1][i] -= e * (az * bx - ax * bz) + f * (bz * cx - bx * cz) + g * (cz * ax - cx * az);
            sums->gradient[2][i] -= e * (ax * by - ay * bx) + f * (bx * cy - by * cx) + g * (cx * ay - cy * ax);
        }
    }
}

INLINE void fetch(const void *address, size_t bytes)
{
    for (size_t at = 0; at < bytes; at += 64) PREFETCH((const char *)address + at);
}

/* `q` in the tree's frame. The gradient is with respect to q there.
 *
 * Large trees wait for memory: what is found to be near is asked for, and read only after the next node. */
INLINE double winding(const Tree *tree, const double *q, double *gradient, const int triangles, const int with_gradient)
{
    const float query[3] = {(float)q[0], (float)q[1], (float)q[2]};
    int32_t stack[STACK], near[LANES], waiting[LANES];
    int depth = 0, leaves = 0;
    Sums sums;
    memset(&sums, 0, sizeof sums);
    stack[depth++] = 0;
    while (depth) {
        const Node *node = &tree->nodes[stack[--depth]];
        add_children(node, query, &sums, near, with_gradient);
        for (int i = 0; i < leaves; i++)
            if (triangles) add_triangles(leaf_at(tree, waiting[i]), query, &sums, with_gradient);
            else add_points(leaf_at(tree, waiting[i]), query, &sums, with_gradient);
        leaves = 0;
        for (int i = 0; i < LANES; i++) {
            if (!near[i]) continue;
            int32_t child = node->child[i];
            if (child >= 0) {
                stack[depth++] = child;
                fetch(&tree->nodes[child], sizeof(Node));
            } else {
                waiting[leaves++] = ~child;
                fetch(leaf_at(tree, ~child), tree->leaf_bytes);
            }
        }
    }
    for (int i = 0; i < leaves; i++)
        if (triangles) add_triangles(leaf_at(tree, waiting[i]), query, &sums, with_gradient);
        else add_points(leaf_at(tree, waiting[i]), query, &sums, with_gradient);
    double value = 0;
    for (int i = 0; i < LANES; i++) value += sums.value[i];
    if (with_gradient)
        for (int k = 0; k < 3; k++) {
            double sum = 0;
            for (int i = 0; i < LANES; i++) sum += sums.gradient[k][i];
            gradient[k] = -OVER_4_PI * sum;
        }
    return OVER_4_PI * value;
}

INLINE void to_tree(const Tree *tree, const double *point, double *q)
{
    for (int k = 0; k < 3; k++) q[k] = (point[k] - tree->center[k]) * tree->scale;
}

/* Infinity and points beyond all float32 squares see nothing. */
INLINE int far_away(const double *q) { return !(fabs(q[0]) < 1e15 && fabs(q[1]) < 1e15 && fabs(q[2]) < 1e15); }

INLINE void rows_of(const Tree *tree, const double *queries, int64_t count, double *values, double *gradients,
                    const int triangles, const int with_gradient)
{
    for (int64_t row = 0; row < count; row++) {
        double q[3], gradient[3] = {0, 0, 0};
        to_tree(tree, queries + 3 * row, q);
        values[row] = far_away(q) ? 0 : winding(tree, q, gradient, triangles, with_gradient);
        if (with_gradient)
            for (int k = 0; k < 3; k++) gradients[3 * row + k] = gradient[k] * tree->scale;
    }
}

/* `gradients` may be NULL. */
VECTOR_CLONES static void winding_rows(const Tree *tree, const double *queries, int64_t count, double *values,
                                       double *gradients)
{
    if (tree->triangles && gradients) rows_of(tree, queries, count, values, gradients, 1, 1);
    else if (tree->triangles) rows_of(tree, queries, count, values, gradients, 1, 0);
    else if (gradients) rows_of(tree, queries, count, values, gradients, 0, 1);
    else rows_of(tree, queries, count, values, gradients, 0, 0);
}

#endif
