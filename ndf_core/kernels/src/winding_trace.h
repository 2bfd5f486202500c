/* Rays to the level set w = 1/2, for many rows. */
#ifndef NDF_WINDING_TRACE_H
#define NDF_WINDING_TRACE_H

#include "winding_sum.h"

#define MOST_STEPS 48 /* evaluations per ray */
#define GROWTH 1.5    /* of the steps of a ray that has not crossed yet */

typedef struct {
    double origin[3], direction[3]; /* in the tree's frame; a unit vector */
    double side;                    /* +1 where the origin is inside, -1 outside: the ray runs along side * direction */
} Ray;

/* Positive until the ray crosses. */
INLINE double excess(const Tree *tree, const Ray *ray, double t, const int triangles)
{
    double q[3];
    for (int k = 0; k < 3; k++) q[k] = ray->origin[k] + ray->side * t * ray->direction[k];
    return ray->side * (winding(tree, q, NULL, triangles, 0) - 0.5);
}

/* The first sign change that steps from `guess` on find, to within `tolerance`; -1 if there is none up to `reach`.
 *
 * Harnack's inequality gives steps that can jump over nothing, but near the surface only of a seventh of the distance
 * each. The caller knows about where the surface is: steps begin there, and grow while nothing is found. */
INLINE double trace(const Tree *tree, const Ray *ray, double start, double guess, double step, double reach,
                    double tolerance, const int triangles)
{
    double low = 0, above = start, high = guess > 0 ? guess : step, below = 0;
    /* Across triangles w jumps: both ends of the guessed crossing are looked at before anything is interpolated. */
    if (triangles && guess > 0) high += 0.5 * tolerance;
    int evaluations = 0;
    for (;; evaluations++) {
        if (evaluations == MOST_STEPS) return -1;
        high = high < reach ? high : reach;
        below = excess(tree, ray, high, triangles);
        if (below < 0) break;
        if (high >= reach) return -1;
        /* The secant through the last two values, if they fall, but never beyond the growing step. */
        double next = below < above ? high + 1.2 * below * (high - low) / (above - below) : INFINITY;
        double most = high + (step > (GROWTH - 1) * high ? step : (GROWTH - 1) * high);
        low = high;
        above = below;
        high = next < most ? next : most;
        high = high > low + 0.5 * tolerance ? high : low + 0.5 * tolerance;
    }
    if (triangles && evaluations == 0 && guess > tolerance) {
        double before = excess(tree, ray, guess - 0.5 * tolerance, triangles);
        if (before >= 0) return guess;
        high = guess - 0.5 * tolerance;
        below = before;
    }
    double weight_low = above, weight_high = below, root = high;
    for (; high - low > tolerance; evaluations++) {
        /* Illinois: the weight of an end that stays is halved, and every fourth turn halves the bracket. */
        root = low + (high - low) * weight_low / (weight_low - weight_high);
        if (evaluations % 4 == 3 || !(root > low && root < high)) root = 0.5 * (low + high);
        double margin = 0.45 * tolerance;
        root = root < low + margin ? low + margin : root > high - margin ? high - margin : root;
        double value = excess(tree, ray, root, triangles);
        if (value >= 0) {
            low = root;
            weight_low = above = value;
            weight_high *= 0.5;
        } else {
            high = root;
            weight_high = below = value;
            weight_low *= 0.5;
        }
        if (evaluations > 4 * MOST_STEPS) return -1;
    }
    double share = above / (above - below); /* above >= 0 > below */
    return low + (high - low) * share;
}

typedef struct {
    const double *origins, *directions, *guesses, *steps, *reaches; /* in the user's units */
} Rays;

INLINE void trace_each(const Tree *tree, const Rays *rays, int64_t count, double tolerance, double *found,
                       const int triangles)
{
    for (int64_t row = 0; row < count; row++) {
        Ray ray;
        to_tree(tree, rays->origins + 3 * row, ray.origin);
        memcpy(ray.direction, rays->directions + 3 * row, sizeof ray.direction);
        found[row] = NAN;
        if (far_away(ray.origin)) continue;
        double w = winding(tree, ray.origin, NULL, triangles, 0);
        ray.side = w > 0.5 ? 1 : -1;
        double scale = tree->scale, t = trace(tree, &ray, fabs(w - 0.5), -ray.side * rays->guesses[row] * scale,
                                              rays->steps[row] * scale, rays->reaches[row] * scale,
                                              tolerance * scale, triangles);
        if (t >= 0) found[row] = ray.side * t / scale;
    }
}

VECTOR_CLONES static void trace_rows(const Tree *tree, const Rays *rays, int64_t count, double tolerance,
                                     double *found)
{
    if (tree->triangles) trace_each(tree, rays, count, tolerance, found, 1);
    else trace_each(tree, rays, count, tolerance, found, 0);
}

#endif
