/* All pairs of faces that properly intersect: each leaf is sent down the tree, and meets the leaves after it. */
#ifndef NDF_BVH_OVERLAP_H
#define NDF_BVH_OVERLAP_H

#include "bvh_tree.h"
#include "triangle_pair.h"

typedef struct {
    float low[3], high[3];
} Box;

typedef struct {
    int32_t *pairs; /* (count, 2), smaller face first */
    int64_t count, capacity, limit;
    int failed;
} PairList;

INLINE int boxes_meet(const Box *a, const Box *b)
{
    return (a->low[0] <= b->high[0]) & (b->low[0] <= a->high[0]) & (a->low[1] <= b->high[1]) &
           (b->low[1] <= a->high[1]) & (a->low[2] <= b->high[2]) & (b->low[2] <= a->high[2]);
}

static Box *face_boxes(const Tree *tree)
{
    Box *boxes = malloc((size_t)tree->face_count * sizeof(Box));
    if (!boxes) return NULL;
    for (int64_t f = 0; f < tree->face_count; f++)
        for (int k = 0; k < 3; k++) {
            const double *a = tree->scaled + 3 * (int64_t)tree->faces[3 * f];
            const double *b = tree->scaled + 3 * (int64_t)tree->faces[3 * f + 1];
            const double *c = tree->scaled + 3 * (int64_t)tree->faces[3 * f + 2];
            double low = a[k] < b[k] ? a[k] : b[k], high = a[k] > b[k] ? a[k] : b[k];
            boxes[f].low[k] = round_down(low < c[k] ? low : c[k]);
            boxes[f].high[k] = round_up(high > c[k] ? high : c[k]);
        }
    return boxes;
}

static void add_pair(PairList *list, int32_t one, int32_t two)
{
    if (list->count == list->capacity) {
        int64_t capacity = list->capacity * 2 + 64;
        int32_t *pairs = realloc(list->pairs, (size_t)capacity * 2 * sizeof(int32_t));
        if (!pairs) { list->failed = 1; return; }
        list->pairs = pairs;
        list->capacity = capacity;
    }
    list->pairs[2 * list->count] = one < two ? one : two;
    list->pairs[2 * list->count++ + 1] = one < two ? two : one;
}

static int list_full(const PairList *list) { return list->failed || list->count >= list->limit; }

/* The smaller face goes first, so that rounding cannot make the answer depend on the tree. */
static int faces_cross(const Tree *tree, int32_t one, int32_t two)
{
    const double *p[3], *q[3];
    for (int i = 0; i < 3; i++) {
        p[i] = tree->scaled + 3 * (int64_t)tree->faces[3 * (int64_t)(one < two ? one : two) + i];
        q[i] = tree->scaled + 3 * (int64_t)tree->faces[3 * (int64_t)(one < two ? two : one) + i];
    }
    return triangles_cross(p, q, tree->noise);
}

static void leaf_against_leaf(const Tree *tree, const Box *boxes, int32_t one, int32_t two, const Box *box_one,
                              PairList *list)
{
    const Leaf *a = &tree->leaves[one], *b = &tree->leaves[two];
    for (int j = 0; j < b->count; j++) {
        if (!boxes_meet(box_one, &boxes[b->face[j]])) continue;
        for (int i = 0; i < (one == two ? j : a->count) && !list_full(list); i++)
            if (boxes_meet(&boxes[a->face[i]], &boxes[b->face[j]]) && faces_cross(tree, a->face[i], b->face[j]))
                add_pair(list, a->face[i], b->face[j]);
    }
}

VECTOR_CLONES
static void leaf_against_tree(const Tree *tree, const Box *boxes, int32_t leaf, const Box *box, PairList *list)
{
    int32_t stack[STACK];
    int top = 0;
    stack[top++] = 0;
    while (top && !list_full(list)) {
        const Node *node = &tree->nodes[stack[--top]];
        int32_t meets[WIDTH];
        for (int i = 0; i < WIDTH; i++)
            meets[i] = (node->low[0][i] <= box->high[0]) & (box->low[0] <= node->high[0][i]) &
                       (node->low[1][i] <= box->high[1]) & (box->low[1] <= node->high[1][i]) &
                       (node->low[2][i] <= box->high[2]) & (box->low[2] <= node->high[2][i]);
        for (int i = 0; i < WIDTH; i++) {
            if (!meets[i]) continue;
            if (node->child[i] >= 0)
                stack[top++] = node->child[i];
            else if (~node->child[i] >= leaf)
                leaf_against_leaf(tree, boxes, leaf, ~node->child[i], box, list);
        }
    }
}

/* Pairs of the leaves of nodes `first` to `last`, without it, and all leaves after each. */
static void find_pairs(const Tree *tree, int64_t first, int64_t last, PairList *list)
{
    Box *boxes = face_boxes(tree);
    if (!boxes) { list->failed = 1; return; }
    for (int64_t n = first; n < last && !list_full(list); n++)
        for (int i = 0; i < WIDTH; i++) {
            const Node *node = &tree->nodes[n];
            if (node->child[i] >= 0) continue;
            Box box;
            for (int k = 0; k < 3; k++) {
                box.low[k] = node->low[k][i];
                box.high[k] = node->high[k][i];
            }
            leaf_against_tree(tree, boxes, ~node->child[i], &box, list);
        }
    free(boxes);
}

#endif
