/* What the test programs share: checks, random numbers, and a scene of small boxes below a lamp. */
#ifndef COMMON_H
#define COMMON_H

#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "mrvis.h"

/* Ends the program unless a call succeeds. */
#define OK(call)                                                                                     \
  do {                                                                                               \
    mrv_status status_ = (call);                                                                     \
    if (status_ != MRV_OK) {                                                                         \
      fprintf(stderr, "%s:%d: %s: %s\n", __FILE__, __LINE__, mrv_status_name(status_), mrv_error_message()); \
      exit(1);                                                                                       \
    }                                                                                                \
  } while (0)

/* Ends the program unless a condition holds. */
#define CHECK(condition)                                                           \
  do {                                                                             \
    if (!(condition)) {                                                            \
      fprintf(stderr, "%s:%d: not true: %s (last message: %s)\n", __FILE__, __LINE__, #condition, mrv_error_message()); \
      exit(1);                                                                     \
    }                                                                              \
  } while (0)

static uint32_t random_state = 1;

/* A number in [0, 1) of 24 bits; the tests in Rust draw the same ones. */
static inline float draw(void) {
  random_state = random_state * 1664525u + 1013904223u;
  return (float)(random_state >> 8) / 16777216.0f;
}

enum { BOXES = 300, BUNDLES = 40, RAYS = 16, SEGMENTS = BUNDLES * RAYS };

/* Writes the corners and faces of a box. */
static inline void put_box(float *positions, uint32_t *indices, uint32_t first, const float *at, float size) {
  static const uint32_t faces[24] = {0, 2, 3, 1, 4, 5, 7, 6, 0, 1, 5, 4, 2, 6, 7, 3, 0, 4, 6, 2, 1, 3, 7, 5};
  for (int i = 0; i < 8; i++) {
    positions[3 * i + 0] = at[0] + ((i & 1) ? size : 0.0f);
    positions[3 * i + 1] = at[1] + ((i & 2) ? size : 0.0f);
    positions[3 * i + 2] = at[2] + ((i & 4) ? size : 0.0f);
  }
  for (int i = 0; i < 24; i++) indices[i] = first + faces[i];
}

/* A floor, a lamp above it, boxes in between. */
static inline mrv_scene *box_scene(void) {
  static float positions[BOXES * 24];
  static uint32_t indices[BOXES * 24], sizes[BOXES * 6], materials[BOXES * 6];
  const float floor_at[12] = {0, 0, 0, 1, 0, 0, 1, 1, 0, 0, 1, 0};
  const double lamp_at[12] = {.4, .4, 1, .6, .4, 1, .6, .6, 1, .4, .6, 1};
  const uint32_t floor_corners[6] = {0, 1, 2, 0, 2, 3}, lamp_corners[4] = {3, 2, 1, 0}, lamp_size = 4;
  const float red[3] = {.75f, .25f, .25f}, black[3] = {0, 0, 0}, light[3] = {10, 10, 10};
  uint32_t grey_index, red_index, lamp_index;
  mrv_scene_builder *builder;
  mrv_scene *scene;
  mrv_mesh mesh;

  OK(mrv_scene_builder_create(&builder));
  OK(mrv_scene_builder_add_material(builder, "grey", NULL, NULL, &grey_index));
  OK(mrv_scene_builder_add_material(builder, "red", red, NULL, &red_index));
  OK(mrv_scene_builder_add_material(builder, "lamp", black, light, &lamp_index));

  memset(&mesh, 0, sizeof mesh);
  mesh.struct_size = sizeof mesh;
  mesh.name = "floor";
  mesh.positions = floor_at;
  mesh.vertex_count = 4;
  mesh.indices = floor_corners;
  mesh.index_count = 6;
  mesh.material = grey_index;
  OK(mrv_scene_builder_add_object(builder, &mesh));

  memset(&mesh, 0, sizeof mesh);
  mesh.struct_size = sizeof mesh;
  mesh.name = "lamp";
  mesh.positions_f64 = lamp_at;
  mesh.vertex_count = 4;
  mesh.indices = lamp_corners;
  mesh.index_count = 4;
  mesh.polygon_sizes = &lamp_size;
  mesh.polygon_count = 1;
  mesh.material = lamp_index;
  OK(mrv_scene_builder_add_object(builder, &mesh));

  random_state = 1;
  for (uint32_t i = 0; i < BOXES; i++) {
    float at[3];
    at[0] = draw();
    at[1] = draw();
    at[2] = .3f + .4f * draw();
    put_box(positions + 24 * i, indices + 24 * i, 8 * i, at, .02f);
    for (int j = 0; j < 6; j++) {
      sizes[6 * i + j] = 4;
      materials[6 * i + j] = i % 2 ? red_index : grey_index;
    }
  }
  memset(&mesh, 0, sizeof mesh);
  mesh.struct_size = sizeof mesh;
  mesh.name = "boxes";
  mesh.positions = positions;
  mesh.position_stride = 12;
  mesh.vertex_count = 8 * BOXES;
  mesh.indices = indices;
  mesh.index_count = 24 * BOXES;
  mesh.polygon_sizes = sizes;
  mesh.polygon_count = 6 * BOXES;
  mesh.face_materials = materials;
  OK(mrv_scene_builder_add_object(builder, &mesh));
  OK(mrv_scene_builder_finish(builder, NULL, &scene));
  mrv_scene_builder_release(builder);
  return scene;
}

/* A batch from the floor to the lamp. */
typedef struct batch {
  float origins[3 * SEGMENTS], targets[3 * SEGMENTS];
  uint64_t offsets[BUNDLES + 1];
  float feature_sizes[BUNDLES], emitter_sizes[BUNDLES];
} batch;

static inline void fill_batch(batch *b) {
  random_state = 7;
  for (int k = 0; k < BUNDLES; k++) {
    const float x = draw(), y = draw();
    b->offsets[k] = (uint64_t)(RAYS * k);
    b->feature_sizes[k] = k % 2 ? .05f : .4f;
    b->emitter_sizes[k] = .15f;
    for (int i = RAYS * k; i < RAYS * (k + 1); i++) {
      b->origins[3 * i + 0] = x;
      b->origins[3 * i + 1] = y;
      b->origins[3 * i + 2] = .001f;
      b->targets[3 * i + 0] = .4f + .2f * draw();
      b->targets[3 * i + 1] = .4f + .2f * draw();
      b->targets[3 * i + 2] = .999f;
    }
  }
  b->offsets[BUNDLES] = SEGMENTS;
}

/* The batch as packed positions. */
static inline mrv_segments packed(const batch *b) {
  mrv_segments segments;
  memset(&segments, 0, sizeof segments);
  segments.struct_size = sizeof segments;
  segments.origins.x = b->origins;
  segments.targets.x = b->targets;
  segments.segment_count = SEGMENTS;
  segments.offsets = b->offsets;
  segments.bundle_count = BUNDLES;
  segments.feature_sizes = b->feature_sizes;
  segments.emitter_sizes = b->emitter_sizes;
  return segments;
}

/* Bits of numbers, for comparisons. */
static inline unsigned bits(float value) {
  uint32_t number;
  memcpy(&number, &value, sizeof number);
  return (unsigned)number;
}

static inline unsigned long long bits_f64(double value) {
  uint64_t number;
  memcpy(&number, &value, sizeof number);
  return (unsigned long long)number;
}

#endif
