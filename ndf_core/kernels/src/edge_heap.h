/* A 4-ary min-heap of integer ids with a key each and the place of every id, so that keys can change and ids can leave.
 * Equal keys come out in order of id, which is what makes decimation the same on every machine. */
#ifndef NDF_EDGE_HEAP_H
#define NDF_EDGE_HEAP_H

#include <stdint.h>
#include <stdlib.h>

typedef struct { double key; int32_t id; } HeapEntry;

typedef struct {
    HeapEntry *entries;
    int32_t *place; /* of each id, -1 where it is not in the heap */
    int32_t count;
} Heap;

static int heap_create(Heap *heap, size_t ids)
{
    heap->entries = malloc((ids + 1) * sizeof *heap->entries);
    heap->place = malloc((ids + 1) * sizeof *heap->place);
    heap->count = 0;
    if (!heap->entries || !heap->place) return -1;
    for (size_t i = 0; i < ids; i++) heap->place[i] = -1;
    return 0;
}

static void heap_destroy(Heap *heap)
{
    free(heap->entries);
    free(heap->place);
}

static inline int heap_before(HeapEntry a, HeapEntry b) { return a.key < b.key || (a.key == b.key && a.id < b.id); }

static inline void heap_put(Heap *heap, int32_t place, HeapEntry entry)
{
    heap->entries[place] = entry;
    heap->place[entry.id] = place;
}

static void heap_up(Heap *heap, int32_t place, HeapEntry entry)
{
    while (place > 0) {
        int32_t parent = (place - 1) / 4;
        if (!heap_before(entry, heap->entries[parent])) break;
        heap_put(heap, place, heap->entries[parent]);
        place = parent;
    }
    heap_put(heap, place, entry);
}

static void heap_down(Heap *heap, int32_t place, HeapEntry entry)
{
    for (;;) {
        int32_t child = 4 * place + 1, end = child + 4 < heap->count ? child + 4 : heap->count;
        if (child >= heap->count) break;
        int32_t least = child;
        for (int32_t i = child + 1; i < end; i++)
            if (heap_before(heap->entries[i], heap->entries[least])) least = i;
        if (!heap_before(heap->entries[least], entry)) break;
        heap_put(heap, place, heap->entries[least]);
        place = least;
    }
    heap_put(heap, place, entry);
}

/* Insert `id`, or change its key. */
static void heap_set(Heap *heap, int32_t id, double key)
{
    HeapEntry entry = {key, id};
    int32_t place = heap->place[id];
    if (place < 0) {
        heap_up(heap, heap->count++, entry);
    } else if (heap_before(entry, heap->entries[place])) {
        heap_up(heap, place, entry);
    } else {
        heap_down(heap, place, entry);
    }
}

static void heap_remove(Heap *heap, int32_t id)
{
    int32_t place = heap->place[id];
    if (place < 0) return;
    heap->place[id] = -1;
    HeapEntry last = heap->entries[--heap->count];
    if (place == heap->count) return;
    if (place > 0 && heap_before(last, heap->entries[(place - 1) / 4]))
        heap_up(heap, place, last);
    else
        heap_down(heap, place, last);
}

#endif
