/* A host with a malloc of its own, which keeps a header before each block: the library takes its memory from there and gives all of
 * it back to there. */
#define _POSIX_C_SOURCE 200809L
#include <errno.h>
#include <stdatomic.h>
#include <stddef.h>
#include <stdint.h>

#include "check.h"

void *__libc_memalign(size_t alignment, size_t size);
void __libc_free(void *block);

/* Before each block: where it really begins, and its size. The mark shows that a block is of this allocator. */
typedef struct {
  void *begin;
  size_t size;
  size_t mark;
} header;

enum { MARK = 0x6d727669 };
static atomic_llong blocks, calls;

static void *take(size_t alignment, size_t size) {
  if (alignment < 32) alignment = 32;
  size_t gap = (sizeof(header) + alignment - 1) / alignment * alignment;
  char *begin = size > SIZE_MAX / 2 ? NULL : __libc_memalign(alignment, size + gap);
  if (begin == NULL) {
    errno = ENOMEM;
    return NULL;
  }
  header *of = (header *)(void *)(begin + gap) - 1;
  *of = (header){begin, size, MARK};
  atomic_fetch_add(&blocks, 1);
  atomic_fetch_add(&calls, 1);
  return begin + gap;
}

void *malloc(size_t size) { return take(0, size); }
void *memalign(size_t alignment, size_t size) { return take(alignment, size); }
void *aligned_alloc(size_t alignment, size_t size) { return take(alignment, size); }

int posix_memalign(void **block, size_t alignment, size_t size) {
  *block = take(alignment, size);
  return *block == NULL ? ENOMEM : 0;
}

void *calloc(size_t count, size_t size) {
  void *block = size != 0 && count > SIZE_MAX / size ? NULL : take(0, count * size);
  return block == NULL ? NULL : memset(block, 0, count * size);
}

void free(void *block) {
  if (block == NULL) return;
  header *of = (header *)block - 1;
  if (of->mark != MARK) abort();
  of->mark = 0;
  atomic_fetch_sub(&blocks, 1);
  __libc_free(of->begin);
}

void *realloc(void *block, size_t size) {
  void *moved = take(0, size);
  if (moved == NULL || block == NULL) return moved;
  size_t old = ((header *)block - 1)->size;
  memcpy(moved, block, old < size ? old : size);
  free(block);
  return moved;
}

static void round_trip(void) {
  mrv_model *model = prepared(2);
  CHECK(seen(model, MRV_ENGINE_MULTI_RESOLUTION, 0.1f) > 0 && light(model) > 0);
  mrv_model_release(model);
}

enum { POINTS = 1000, RAYS = 32 };
static float from[POINTS * RAYS][3], to[POINTS * RAYS][3], seen_of[POINTS], segments_of[POINTS * RAYS];
static uint64_t offsets[POINTS + 1];

/* Sum of the transmittances from points above the floor to the lamp, in one batch; with those of segments if `apart`. */
static double batch(const mrv_model *model, int32_t engine, int apart) {
  double sum = 0;
  RECORD(mrv_segments, segments);
  RECORD(mrv_answers, answers);
  for (int i = 0; i < POINTS * RAYS; i++) {
    const int point = i / RAYS, ray = i % RAYS;
    from[i][0] = (float)(point % 40 + .5) / 40, from[i][1] = (float)(point / 40 + .5) / 25, from[i][2] = .01f;
    to[i][0] = .3f + .4f * (float)ray / RAYS, to[i][1] = .3f + .4f * (float)(ray % 8) / 8, to[i][2] = .99f;
    offsets[point + 1] = (uint64_t)i + 1;
  }
  segments.origins.x = from[0], segments.targets.x = to[0], segments.segment_count = POINTS * RAYS;
  segments.offsets = offsets, segments.bundle_count = POINTS, segments.feature_size = .1f;
  answers.transmittance = seen_of, answers.segment_transmittance = apart ? segments_of : NULL;
  CHECK(mrv_visibility_answer(model, engine, &segments, &answers, NULL) == MRV_OK);
  for (int i = 0; i < POINTS; i++) sum += (double)seen_of[i];
  return sum;
}

/* A model with one thread answers batches on this one, in buffers that it keeps. */
static void batches_without_allocation(void) {
  const int32_t engines[] = {MRV_ENGINE_EXACT, MRV_ENGINE_MULTI_RESOLUTION, MRV_ENGINE_AVERAGE, MRV_ENGINE_AUTOMATIC};
  mrv_model *model = prepared(1);
  for (int i = 0; i < 8; i++) {
    const double first = batch(model, engines[i / 2], i % 2);
    const long long before = atomic_load(&calls);
    const double second = batch(model, engines[i / 2], i % 2);
    const long long called = atomic_load(&calls) - before;
    fprintf(stderr, "engine %d: %g seen, %lld blocks taken\n", (int)engines[i / 2], second, called);
    CHECK(second >= first && second <= first && called == 0);
  }
  mrv_model_release(model);
}

int main(void) {
  batches_without_allocation();
  round_trip();
  long long before = atomic_load(&blocks), calls_before = atomic_load(&calls);
  for (int i = 0; i < 3; i++) round_trip();
  long long left = atomic_load(&blocks) - before, called = atomic_load(&calls) - calls_before;
  fprintf(stderr, "%lld blocks taken, %lld more held than before\n", called, left);
  /* Threads of the pools end after the models; a few of their blocks may still be held. */
  CHECK(called > 1000 && left < 100);
  puts("done");
  return 0;
}
