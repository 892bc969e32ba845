/* Callbacks that cancel in the middle of the work, that ask about other models and the one at work, and that release handles; and work
 * for which there is no memory. */
#ifdef __linux__
#define _GNU_SOURCE
#endif
#include <time.h>
#include <unistd.h>
#if defined(__linux__)
#include <sys/resource.h>
#endif

#include "common.h"

static const mrv_scene *scene;
static const mrv_model *model;

/* Threads of the models here. */
enum { THREADS = 2 };

/* Time of the processor that this process took, on all threads: other programs do not prolong it. Above 0. */
static double seconds(void) {
  const clock_t now = clock();
  CHECK(now != (clock_t)-1);
  return 1 + (double)now / CLOCKS_PER_SEC;
}

/* Cancels at the call with this number, counted from 1. */
typedef struct stop {
  int at, calls;
  double cancelled; /* when */
} stop;

static int32_t stop_later(void *user, const char *stage, double done) {
  stop *s = (stop *)user;
  CHECK(stage != NULL && done <= 1);
  CHECK(s->cancelled == 0); /* not called again */
  if (++s->calls < s->at) return 0;
  s->cancelled = seconds();
  return 1;
}

/* The work has ended within a second of all threads after it was cancelled. */
static void ended_soon(const stop *s) {
  CHECK(s->calls == s->at && seconds() - s->cancelled < THREADS);
}

static mrv_form_factor_options long_form_factors(mrv_progress progress, void *user) {
  mrv_form_factor_options options;
  memset(&options, 0, sizeof options);
  options.struct_size = sizeof options;
  options.rays = 1u << 18;
  options.pair_rays = 1u << 22;
  options.progress = progress;
  options.user = user;
  return options;
}

static mrv_solve_options long_solve(mrv_progress progress, void *user) {
  mrv_solve_options options;
  memset(&options, 0, sizeof options);
  options.struct_size = sizeof options;
  options.error = 1e-4;
  options.progress = progress;
  options.user = user;
  return options;
}

static mrv_bench_options long_bench(mrv_progress progress, void *user) {
  mrv_bench_options options;
  memset(&options, 0, sizeof options);
  options.struct_size = sizeof options;
  options.points = 200;
  options.rays = 4;
  options.reference_rays = 64;
  options.progress = progress;
  options.user = user;
  return options;
}

static void cancelled_in_the_middle(int at) {
  stop s = {at, 0, 0};
  mrv_form_factors *factors = NULL;
  mrv_bench_report *report = NULL;
  mrv_solution *light;
  mrv_solution_info info;
  mrv_reference_options reference;
  double found[3] = {7, 7, 7}, position[3] = {.3, .3, 0}, normal[3] = {0, 0, 1};
  const mrv_form_factor_options f = long_form_factors(stop_later, &s);
  const mrv_solve_options l = long_solve(stop_later, &s);
  const mrv_bench_options b = long_bench(stop_later, &s);
  CHECK(mrv_model_form_factors(model, &f, &factors) == MRV_ERROR_CANCELLED && factors == NULL);
  ended_soon(&s);
  s.calls = 0, s.cancelled = 0;
  OK(mrv_model_solve(model, &l, &light));
  ended_soon(&s);
  memset(&info, 0, sizeof info);
  info.struct_size = sizeof info;
  OK(mrv_solution_get_info(light, &info));
  CHECK(info.interrupted && info.elements > 0);
  mrv_solution_release(light);
  s.calls = 0, s.cancelled = 0;
  CHECK(mrv_model_bench(model, &b, &report) == MRV_ERROR_CANCELLED && report == NULL);
  CHECK(s.calls == at);
  s.calls = 0, s.cancelled = 0;
  memset(&reference, 0, sizeof reference);
  reference.struct_size = sizeof reference;
  reference.samples = 1u << 20;
  reference.progress = stop_later;
  reference.user = &s;
  enum { POINTS = 512 };
  static double positions[3 * POINTS], normals[3 * POINTS], irradiance[3 * POINTS];
  for (int i = 0; i < POINTS; i++) {
    memcpy(positions + 3 * i, position, sizeof position);
    memcpy(normals + 3 * i, normal, sizeof normal);
  }
  memcpy(irradiance, found, sizeof found);
  CHECK(mrv_model_reference(model, positions, normals, POINTS, &reference, irradiance, NULL) == MRV_ERROR_CANCELLED);
  CHECK(s.calls == at && irradiance[0] == 7);
}

/* Pictures, lightmaps and files of a solution. */
static void shown_in_part(int at) {
  enum { SIDE = 2048 };
  static float radiance[3 * SIDE * SIDE];
  stop s = {at, 0, 0};
  mrv_solve_options solve;
  mrv_solution *light;
  mrv_camera camera;
  mrv_image_options image;
  mrv_lightmap_options texels;
  mrv_lightmap *lightmap = NULL;
  memset(&solve, 0, sizeof solve);
  solve.struct_size = sizeof solve;
  solve.error = .5;
  solve.min_area = 1e-3;
  solve.no_audit = 1;
  OK(mrv_model_solve(model, &solve, &light));
  memset(&camera, 0, sizeof camera);
  camera.struct_size = sizeof camera;
  OK(mrv_solution_get_camera(light, &camera));
  memset(&image, 0, sizeof image);
  image.struct_size = sizeof image;
  image.width = image.height = SIDE;
  image.gather = 1;
  image.progress = stop_later;
  image.user = &s;
  radiance[7] = 7;
  CHECK(mrv_solution_image(light, &camera, &image, radiance, sizeof radiance / sizeof *radiance) == MRV_ERROR_CANCELLED);
  ended_soon(&s);
  CHECK(radiance[7] == 7);
  s.calls = 0, s.cancelled = 0;
  memset(&texels, 0, sizeof texels);
  texels.struct_size = sizeof texels;
  texels.texels = 1u << 24;
  texels.progress = stop_later;
  texels.user = &s;
  CHECK(mrv_solution_lightmap(light, &texels, &lightmap) == MRV_ERROR_CANCELLED && lightmap == NULL);
  ended_soon(&s);
  mrv_solution_release(light);
}

/* A file that is stopped: it is complete, or there is none. */
static void written_in_part(void) {
  static const char *const extensions[] = {"vtu", "ply", "glb"};
  char name[64];
  mrv_solve_options solve;
  mrv_solution *light;
  memset(&solve, 0, sizeof solve);
  solve.struct_size = sizeof solve;
  solve.error = .5;
  solve.no_audit = 1;
  OK(mrv_model_solve(model, &solve, &light));
  for (int i = 0; i < 12; i++) {
    stop s = {1 + i / 3, 0, 0};
    snprintf(name, sizeof name, P_tmpdir "/mrvis-%ld.%s", (long)getpid(), extensions[i % 3]);
    const mrv_status status = mrv_solution_write(light, name, stop_later, &s);
    FILE *file = fopen(name, "rb");
    CHECK(status == MRV_OK || status == MRV_ERROR_CANCELLED);
    CHECK((status == MRV_OK) == (file != NULL) && (s.at > 1 || status == MRV_ERROR_CANCELLED));
    if (file != NULL) fclose(file);
    remove(name);
  }
  mrv_solution_release(light);
}

static void prepared_in_part(void) {
  /* Large enough that a preparation calls more than twice. */
  const mrv_generate_options options = {sizeof options, 2, 3000, 0, 0, 0, 0, 0};
  stop s = {3, 0, 0};
  mrv_scene *cubes;
  mrv_model *none = NULL;
  mrv_prepare_options prepare = {sizeof prepare, 0, 1, NULL, stop_later, &s, 0, 0};
  OK(mrv_scene_generate_with("cubes", &options, &cubes));
  CHECK(mrv_model_prepare(cubes, &prepare, &none) == MRV_ERROR_CANCELLED && none == NULL);
  ended_soon(&s);
  mrv_scene_release(cubes);
}

/* What a callback does with the library. */
typedef struct nest {
  const mrv_model *other;
  mrv_scene *released;
  mrv_model *at_work;
  int calls, depth;
} nest;

static void ask_batch(const mrv_model *of) {
  static batch b;
  float found[BUNDLES];
  const mrv_answers answers = {sizeof answers, found, NULL, NULL, NULL, NULL};
  mrv_segments segments;
  fill_batch(&b);
  segments = packed(&b);
  OK(mrv_visibility_answer(of, MRV_ENGINE_MULTI_RESOLUTION, &segments, &answers, NULL));
}

static int32_t use_library(void *user, const char *stage, double done) {
  nest *n = (nest *)user;
  mrv_scene_info info;
  mrv_solution *light;
  (void)stage;
  (void)done;
  if (n->calls++ == 0) {
    /* Handles of the running call, too. */
    mrv_scene_release(n->released);
    mrv_model_release(n->at_work);
    memset(&info, 0, sizeof info);
    info.struct_size = sizeof info;
    CHECK(mrv_scene_get_info(n->released, &info) == MRV_ERROR_INPUT && strstr(mrv_error_message(), "released") != NULL);
  }
  ask_batch(n->other);
  ask_batch(model); /* at work */
  CHECK(strstr(mrv_error_message(), "released") != NULL);
  if (n->depth > 0) {
    nest inner = {n->other, NULL, NULL, 1, n->depth - 1};
    mrv_solve_options options = long_solve(use_library, &inner);
    options.error = .9;
    options.min_area = 1e-3;
    options.no_audit = 1;
    OK(mrv_model_solve(model, &options, &light));
    CHECK(inner.calls > 1);
    mrv_solution_release(light);
    n->depth = 0;
  }
  return n->calls > 4;
}

/* The pools of both models are at work or idle: no call of the callback waits for the end of the work. */
static void called_from_callbacks(void) {
  const mrv_prepare_options one = {sizeof one, 0, 2, NULL, NULL, NULL, 0, 0};
  mrv_scene *s;
  mrv_model *m;
  mrv_form_factors *factors = NULL;
  nest n = {NULL, NULL, NULL, 0, 2};
  OK(mrv_scene_generate("cornell", &s));
  OK(mrv_model_prepare(scene, &one, &m));
  OK(mrv_model_retain(model));
  n.other = m;
  n.released = s;
  n.at_work = (mrv_model *)(uintptr_t)model;
  const mrv_form_factor_options f = long_form_factors(use_library, &n);
  CHECK(mrv_model_form_factors(model, &f, &factors) == MRV_ERROR_CANCELLED && n.calls == 5);
  mrv_model_release(m);
}

/* Requests that do not fit into the address space get a status. */
static void no_room(void) {
#if defined(__linux__) && !defined(__SANITIZE_ADDRESS__)
  enum { POINTS = 1 << 22 };
  const mrv_solve_options quick = {sizeof quick, 0, 0, .9, 0, 0, 0, 0, 0, 0, NULL, NULL, 0, NULL, 0, NULL, NULL, 0, 1, 0, 0};
  struct rlimit limit, before;
  long pages = 0;
  FILE *file;
  mrv_solution *light;
  mrv_camera camera;
  mrv_image_options image;
  mrv_fbem_images images;
  double *positions = (double *)calloc(3 * POINTS, sizeof(double)), *normals = (double *)calloc(3 * POINTS, sizeof(double));
  float *texels = (float *)calloc(POINTS, sizeof(float));
  const double size = 1;
  double error;
  CHECK(positions != NULL && normals != NULL && texels != NULL);
  for (int i = 0; i < POINTS; i++) normals[3 * i + 2] = 1;
  OK(mrv_model_solve(model, &quick, &light));
  memset(&camera, 0, sizeof camera);
  camera.struct_size = sizeof camera;
  OK(mrv_solution_get_camera(light, &camera));
  file = fopen("/proc/self/statm", "r");
  CHECK(file != NULL && fscanf(file, "%ld", &pages) == 1);
  fclose(file);
  CHECK(getrlimit(RLIMIT_AS, &before) == 0);
  limit = before;
  limit.rlim_cur = (rlim_t)pages * 4096 + (64u << 20);
  CHECK(setrlimit(RLIMIT_AS, &limit) == 0);
  CHECK(mrv_solution_irradiance(light, positions, normals, POINTS, positions) == MRV_ERROR_INPUT); /* overlap */
  double *out = normals; /* not written */
  double *const in = positions;
  CHECK(mrv_solution_irradiance(light, in, in + 3, POINTS - 1, out) == MRV_ERROR_OUT_OF_MEMORY);
  CHECK(strstr(mrv_error_message(), "4194303 points") != NULL && out[2] == 1);
  CHECK(mrv_model_reference(model, in, in + 3, POINTS - 1, NULL, out, NULL) == MRV_ERROR_OUT_OF_MEMORY);
  memset(&image, 0, sizeof image);
  image.struct_size = sizeof image;
  image.width = image.height = 1024;
  CHECK(mrv_solution_image(light, &camera, &image, texels, 3 * 1024 * 1024) == MRV_ERROR_OUT_OF_MEMORY);
  memset(&images, 0, sizeof images);
  images.struct_size = sizeof images;
  images.reference = images.approximation = texels;
  images.width = images.height = 2048;
  CHECK(mrv_fbem(&images, &size, 1, &error, NULL) == MRV_ERROR_OUT_OF_MEMORY);
  CHECK(setrlimit(RLIMIT_AS, &before) == 0);
  mrv_solution_release(light);
  free(positions);
  free(normals);
  free(texels);
#endif
}

int main(void) {
  const mrv_prepare_options options = {sizeof options, MRV_DETAIL_OPTICS, THREADS, NULL, NULL, NULL, 0, 0};
  mrv_scene *s = box_scene();
  mrv_model *m;
  OK(mrv_model_prepare(s, &options, &m));
  scene = s;
  model = m;
  cancelled_in_the_middle(2);
  cancelled_in_the_middle(4);
  shown_in_part(2);
  shown_in_part(4);
  written_in_part();
  prepared_in_part();
  called_from_callbacks();
  no_room();
  mrv_scene_release(s);
  mrv_model_release(m);
  return 0;
}
