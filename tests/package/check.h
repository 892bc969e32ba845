/* What the hosts of the tests share: checks, and light in a small scene as a number that is the same in every process. */
#ifndef CHECK_H
#define CHECK_H

#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "mrvis.h"

/* Ends the program unless a condition holds. */
#define CHECK(condition)                                                                                        \
  do {                                                                                                          \
    if (!(condition)) {                                                                                         \
      fprintf(stderr, "%s:%d: not true: %s; %s\n", __FILE__, __LINE__, #condition, mrv_error_message());        \
      exit(1);                                                                                                  \
    }                                                                                                           \
  } while (0)

/* A record of zeros with its size. */
#define RECORD(type, name) \
  type name;               \
  memset(&name, 0, sizeof name); \
  name.struct_size = sizeof name

enum { LEAVES = 300 };

/* A floor of 1 m, a lamp above it and small triangles in between, prepared with a number of threads. */
static inline mrv_model *prepared(uint32_t threads) {
  const float floor_at[12] = {0, 0, 0, 1, 0, 0, 1, 1, 0, 0, 1, 0}, lamp_at[12] = {.3f, .3f, 1, .7f, .3f, 1, .7f, .7f, 1, .3f, .7f, 1};
  const uint32_t up[6] = {0, 1, 2, 0, 2, 3}, down[6] = {0, 2, 1, 0, 3, 2};
  const float black[3] = {0, 0, 0}, bright[3] = {10, 10, 10};
  float leaves[LEAVES * 9];
  uint32_t corners[LEAVES * 3], state = 1;
  for (uint32_t i = 0; i < LEAVES * 9; i++) {
    state = state * 1664525u + 1013904223u;
    float number = (float)(state >> 8) / 16777216;
    leaves[i] = i % 9 < 3 ? .1f + .8f * number : leaves[i - i % 9 + i % 3] + .1f * (number - .5f);
    corners[i / 3] = i / 3;
  }
  mrv_scene_builder *builder = NULL;
  mrv_scene *scene = NULL;
  mrv_model *model = NULL;
  RECORD(mrv_prepare_options, options);
  RECORD(mrv_mesh, mesh);
  options.threads = threads;
  CHECK(mrv_scene_builder_create(&builder) == MRV_OK);
  CHECK(mrv_scene_builder_add_material(builder, "grey", NULL, NULL, NULL) == MRV_OK);
  CHECK(mrv_scene_builder_add_material(builder, "lamp", black, bright, NULL) == MRV_OK);
  mesh.name = "leaves", mesh.positions = leaves, mesh.vertex_count = LEAVES * 3;
  mesh.indices = corners, mesh.index_count = LEAVES * 3;
  CHECK(mrv_scene_builder_add_object(builder, &mesh) == MRV_OK);
  mesh.name = "floor", mesh.positions = floor_at, mesh.vertex_count = 4, mesh.indices = up, mesh.index_count = 6;
  CHECK(mrv_scene_builder_add_object(builder, &mesh) == MRV_OK);
  mesh.name = "lamp", mesh.positions = lamp_at, mesh.indices = down, mesh.material = 1;
  CHECK(mrv_scene_builder_add_object(builder, &mesh) == MRV_OK);
  CHECK(mrv_scene_builder_finish(builder, NULL, &scene) == MRV_OK);
  mrv_scene_builder_release(builder);
  CHECK(mrv_model_prepare(scene, &options, &model) == MRV_OK);
  mrv_scene_release(scene);
  return model;
}

/* Sum of the transmittances from points of the floor to the lamp, by an engine. */
static inline double seen(const mrv_model *model, int32_t engine, float feature_size) {
  double sum = 0;
  for (int i = 0; i < 64; i++) {
    RECORD(mrv_query, query);
    RECORD(mrv_answer, answer);
    query.position[0] = (i % 8 + 0.5) / 8;
    query.position[1] = (i / 8 + 0.5) / 8;
    query.normal[2] = 1;
    query.feature_size = feature_size;
    CHECK(mrv_visibility_query(model, engine, &query, &answer, NULL) == MRV_OK);
    CHECK(answer.transmittance >= 0 && answer.transmittance <= 1);
    sum += (double)answer.transmittance;
  }
  return sum;
}

/* Mean irradiance of a solution with a coarse error, W/m^2. */
static inline double light(const mrv_model *model) {
  mrv_solution *solution = NULL;
  RECORD(mrv_solve_options, options);
  RECORD(mrv_solution_info, info);
  options.error = 0.5, options.min_area = 0.01;
  CHECK(mrv_model_solve(model, &options, &solution) == MRV_OK);
  CHECK(mrv_solution_get_info(solution, &info) == MRV_OK);
  mrv_solution_release(solution);
  return info.mean_irradiance[1];
}

#endif
