/* The smallest program that does everything once: errors, a scene, queries, progress from frames that can be unwound, light. */
#include <execinfo.h>

#include "check.h"

static int deepest = 0;

static int32_t progress(void *user, const char *stage, double done) {
  void *frames[64];
  int depth = backtrace(frames, 64);
  if (depth > deepest) deepest = depth;
  (void)done;
  *(int *)user += stage[0] != '\0';
  return 0;
}

int main(void) {
  int calls = 0;
  mrv_scene *scene = NULL;
  mrv_solution *solution = NULL;
  RECORD(mrv_solve_options, options);

  CHECK(mrv_version() == MRV_VERSION);
  CHECK(mrv_scene_load("no/such/file.obj", NULL, &scene) == MRV_ERROR_IO && scene == NULL);
  CHECK(strstr(mrv_error_message(), "file.obj") != NULL);
  CHECK(mrv_scene_generate("atlantis", &scene) == MRV_ERROR_INPUT && scene == NULL);

  mrv_model *model = prepared(2);
  CHECK(seen(model, MRV_ENGINE_EXACT, 0) > 0);
  CHECK(seen(model, MRV_ENGINE_MULTI_RESOLUTION, 0.1f) > 0);
  options.error = 0.5, options.min_area = 0.01;
  options.progress = progress;
  options.user = &calls;
  CHECK(mrv_model_solve(model, &options, &solution) == MRV_OK);
  /* The table of frames that exceptions need also leads through the static library to main. */
  CHECK(calls > 0 && deepest > 4);
  mrv_solution_release(solution);
  mrv_model_release(model);
  puts("done");
  return 0;
}
