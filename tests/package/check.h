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

/* A generated scene, prepared with a number of threads. */
static inline mrv_model *prepared(const char *name, uint32_t threads) {
  mrv_scene *scene = NULL;
  mrv_model *model = NULL;
  RECORD(mrv_prepare_options, options);
  options.threads = threads;
  CHECK(mrv_scene_generate(name, &scene) == MRV_OK);
  CHECK(mrv_model_prepare(scene, &options, &model) == MRV_OK);
  mrv_scene_release(scene);
  return model;
}

/* Sum of the transmittances from a grid of points to the first source, by an engine. */
static inline double seen(const mrv_model *model, int32_t engine, float feature_size) {
  double sum = 0;
  for (int i = 0; i < 64; i++) {
    RECORD(mrv_query, query);
    RECORD(mrv_answer, answer);
    mrv_scene *scene = NULL;
    RECORD(mrv_scene_info, info);
    CHECK(mrv_model_get_scene(model, &scene) == MRV_OK);
    CHECK(mrv_scene_get_info(scene, &info) == MRV_OK);
    mrv_scene_release(scene);
    for (int axis = 0; axis < 3; axis++) {
      double part = axis == 0 ? (i % 8 + 0.5) / 8 : axis == 1 ? (i / 8 + 0.5) / 8 : 0.02;
      query.position[axis] = info.low[axis] + part * (info.high[axis] - info.low[axis]);
    }
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
  options.error = 0.1;
  CHECK(mrv_model_solve(model, &options, &solution) == MRV_OK);
  CHECK(mrv_solution_get_info(solution, &info) == MRV_OK);
  mrv_solution_release(solution);
  return info.mean_irradiance[1];
}

#endif
