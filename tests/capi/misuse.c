/* Whatever a program passes gets a status and a message, never a crash, and nothing is written outside of its arrays. Prints the
 * messages; an argument is the number of lives of handles, 0 under Valgrind. */
#ifdef __linux__
#define _GNU_SOURCE
#endif
#include <math.h>
#include <pthread.h>
#include <unistd.h>
#if defined(__x86_64__)
#include <xmmintrin.h>
#endif

#include "common.h"

/* A call that is refused as wrong input, with a message that holds `word`. */
#define WRONG(call, word)                                                                                    \
  do {                                                                                                       \
    const mrv_status status_ = (call);                                                                       \
    if (status_ != MRV_ERROR_INPUT || strstr(mrv_error_message(), word) == NULL) {                           \
      fprintf(stderr, "%s:%d: %s: %s, which does not name %s\n", __FILE__, __LINE__, mrv_status_name(status_), \
              mrv_error_message(), word);                                                                    \
      exit(1);                                                                                               \
    }                                                                                                        \
    puts(mrv_error_message());                                                                               \
  } while (0)

/* A member that the library was given as zero, with a value that it refuses. */
#define REFUSED(member, value, call, word) \
  do {                                     \
    member = value;                        \
    WRONG(call, word);                     \
    member = 0;                            \
  } while (0)

static const mrv_scene *scene;
static const mrv_model *model;

static void nulls(void) {
  mrv_scene *s;
  mrv_model *m;
  mrv_solution *l;
  mrv_form_factors *f;
  mrv_scene_builder *b;
  mrv_scene_info si = {sizeof si, 0, 0, 0, 0, 0, 0, 0, {0}, {0}, {0}};
  mrv_segments segments;
  const mrv_answers answers = {sizeof answers, NULL, NULL, NULL, NULL, NULL};
  const char *name;
  uint32_t index;
  memset(&segments, 0, sizeof segments);
  segments.struct_size = sizeof segments;
  WRONG(mrv_embree_version(NULL, 9), "text");
  WRONG(mrv_scene_load(NULL, NULL, &s), "path");
  WRONG(mrv_scene_load("a.obj", NULL, NULL), "scene");
  WRONG(mrv_scene_generate(NULL, &s), "name");
  WRONG(mrv_scene_generate("cubes", NULL), "scene");
  WRONG(mrv_scene_retain(NULL), "scene");
  WRONG(mrv_scene_get_info(NULL, &si), "scene");
  WRONG(mrv_scene_get_info(scene, NULL), "info");
  WRONG(mrv_scene_get_name(scene, MRV_NAME_OBJECT, 0, NULL), "name");
  WRONG(mrv_scene_get_unit(scene, NULL, 4), "text");
  WRONG(mrv_scene_builder_create(NULL), "builder");
  OK(mrv_scene_builder_create(&b));
  WRONG(mrv_scene_builder_add_material(NULL, "a", NULL, NULL, &index), "builder");
  WRONG(mrv_scene_builder_add_material(b, NULL, NULL, NULL, &index), "name");
  WRONG(mrv_scene_builder_add_object(b, NULL), "mesh");
  WRONG(mrv_scene_builder_add_shared_mesh(b, NULL, &index), "mesh");
  WRONG(mrv_scene_builder_add_instance(b, 0, "a", NULL), "transform");
  WRONG(mrv_scene_builder_finish(b, NULL, NULL), "scene");
  mrv_scene_builder_release(b);
  WRONG(mrv_model_prepare(NULL, NULL, &m), "scene");
  WRONG(mrv_model_prepare(scene, NULL, NULL), "model");
  WRONG(mrv_model_retain(NULL), "model");
  WRONG(mrv_model_get_scene(model, NULL), "scene");
  WRONG(mrv_model_get_info(model, NULL), "info");
  WRONG(mrv_model_get_instance(model, 0, NULL), "instance");
  WRONG(mrv_model_update(model, NULL, 2, &m), "changes");
  WRONG(mrv_model_update(model, NULL, 0, NULL), "updated");
  mrv_instance_change changes[2];
  memset(changes, 0, sizeof changes);
  for (int i = 0; i < 2; i++) {
    changes[i].struct_size = sizeof changes[i];
    changes[i].kind = MRV_CHANGE_SHOW;
    changes[i].instance = i == 0 ? 0 : 999;
  }
  WRONG(mrv_model_update(model, changes, 2, &m), "`changes`[0].instance 0: the scene");
  WRONG(mrv_model_update(model, changes + 1, 1, &m), "`changes`[0].instance 999: does not exist");
  WRONG(mrv_visibility_answer(NULL, 0, &segments, &answers, NULL), "model");
  WRONG(mrv_visibility_answer(model, 0, NULL, &answers, NULL), "segments");
  WRONG(mrv_visibility_answer(model, 0, &segments, NULL, NULL), "answers");
  WRONG(mrv_visibility_answer(model, 0, &segments, &answers, NULL), "transmittance");
  WRONG(mrv_visibility_query(model, 0, NULL, NULL, NULL), "query");
  WRONG(mrv_model_solve(NULL, NULL, &l), "model");
  WRONG(mrv_model_solve(model, NULL, NULL), "solution");
  WRONG(mrv_solution_get_info(NULL, NULL), "solution");
  WRONG(mrv_solution_irradiance(NULL, NULL, NULL, 0, NULL), "solution");
  WRONG(mrv_model_form_factors(NULL, NULL, &f), "model");
  WRONG(mrv_form_factors_get_arrays(NULL, NULL), "factors");
  WRONG(mrv_form_factors_get_row(NULL, 0, NULL, NULL, NULL), "factors");
  WRONG(mrv_form_factors_get_name(NULL, 0, &name), "factors");
  WRONG(mrv_form_factors_write(NULL, "a.csv"), "factors");
  WRONG(mrv_solution_get_elements(NULL, NULL), "solution");
  WRONG(mrv_solution_get_json(NULL, &name), "solution");
  WRONG(mrv_solution_get_page(NULL, &name), "solution");
  WRONG(mrv_solution_get_camera(NULL, NULL), "solution");
  WRONG(mrv_solution_image(NULL, NULL, NULL, NULL, 0), "solution");
  WRONG(mrv_solution_lightmap(NULL, NULL, NULL), "solution");
  WRONG(mrv_lightmap_get_arrays(NULL, NULL), "lightmap");
  WRONG(mrv_scene_get_camera(scene, 0, NULL), "camera");
  WRONG(mrv_model_bench(model, NULL, NULL), "report");
  WRONG(mrv_bench_report_get_text(NULL, NULL, NULL), "report");
  WRONG(mrv_model_reference(model, NULL, NULL, 1, NULL, NULL, NULL), "positions");
  WRONG(mrv_fbem(NULL, NULL, 0, NULL, NULL), "images");
  mrv_lightmap_release(NULL);
  mrv_bench_report_release(NULL);
  mrv_scene_release(NULL);
  mrv_scene_builder_release(NULL);
  mrv_model_release(NULL);
  mrv_solution_release(NULL);
  mrv_form_factors_release(NULL);
}

static void sizes_and_numbers(void) {
  mrv_scene *s;
  mrv_model *m;
  mrv_solution *l;
  mrv_form_factors *f;
  struct {
    mrv_prepare_options known;
    int64_t later[4];
  } newer;
  mrv_load_options load;
  mrv_solve_options solve;
  mrv_form_factor_options factors;
  mrv_scene_info info = {3, 0, 0, 0, 0, 0, 0, 0, {0}, {0}, {0}};
  const char *name = "kept";
  const char *names[1] = {"no such"}, *floor_name[1] = {"floor"};
  const float negative = -1;
  mrv_generate_options generate = {sizeof generate, 0, 1ull << 40, 0, 0, 0, 0, 0};
  const double watts = 5, nan_watts = NAN;
  const int32_t unit = 9;
  memset(&load, 0, sizeof load);
  load.struct_size = sizeof load;
  WRONG(mrv_scene_get_info(scene, &info), "sizeof(mrv_scene_info)");
  CHECK(info.struct_size == 3 && info.triangles == 0);
  memset(&newer, 0, sizeof newer);
  newer.known.struct_size = 8;
  WRONG(mrv_model_prepare(scene, &newer.known, &m), "struct_size` 8");
  newer.known.struct_size = 1u << 30;
  WRONG(mrv_model_prepare(scene, &newer.known, &m), "struct_size");
  newer.known.struct_size = sizeof newer;
  newer.known.detail = MRV_DETAIL_RAYS;
  OK(mrv_model_prepare(scene, &newer.known, &m));
  mrv_model_release(m);
  newer.later[2] = 1;
  CHECK(mrv_model_prepare(scene, &newer.known, &m) == MRV_ERROR_UNSUPPORTED);
  newer.later[2] = 0;
  REFUSED(newer.known.detail, 77, mrv_model_prepare(scene, &newer.known, &m), "detail` 77");
  newer.known.builder = 9;
  WRONG(mrv_model_prepare(scene, &newer.known, &m), "builder` 9");
  newer.known.builder = MRV_BUILDER_SAH;
  OK(mrv_model_prepare(scene, &newer.known, &m));
  mrv_model_release(m);
  newer.known.builder = 0;
  newer.known.threads = 1u << 20;
  WRONG(mrv_model_prepare(scene, &newer.known, &m), "`options.threads` 1048576");
  WRONG(mrv_scene_get_name(scene, 9, 0, &name), "kind` 9");
  WRONG(mrv_scene_get_name(scene, MRV_NAME_OBJECT, 1u << 20, &name), "index` 1048576");
  WRONG(mrv_scene_get_name(scene, MRV_NAME_OBJECT, UINT64_MAX, &name), "index");
  CHECK(strcmp(name, "kept") == 0);
  WRONG(mrv_scene_generate("no such", &s), "no such");
  WRONG(mrv_scene_generate("\xff\xfe", &s), "UTF-8");
  CHECK(mrv_scene_load("/nonexistent/a.obj", NULL, &s) == MRV_ERROR_IO);
  REFUSED(load.reserved, 1, mrv_scene_load("a.obj", &load, &s), "`options.reserved` 1");
  REFUSED(load.sides, -3, mrv_scene_load("a.obj", &load, &s), "sides` -3");
  load.emitter_count = 1;
  WRONG(mrv_scene_load("a.obj", &load, &s), "emitters");
  load.emitters = names;
  WRONG(mrv_scene_load("a.obj", &load, &s), "emitter_watts");
  load.emitter_count = SIZE_MAX / 2;
  load.emitter_watts = &watts;
  WRONG(mrv_scene_load("a.obj", &load, &s), "emitters");
  load.emitter_count = 1;
  REFUSED(load.emitter_units, &unit, mrv_scene_load("a.obj", &load, &s), "emitter_units` 9");
  REFUSED(load.up, 3, mrv_scene_load("a.obj", &load, &s), "`options.up` 3");
  REFUSED(load.channels, -1, mrv_scene_load("a.obj", &load, &s), "`options.channels` -1");
  load.luminaires = "/nonexistent/lamps.toml";
  CHECK(mrv_scene_load("a.obj", &load, &s) == MRV_ERROR_IO);
  load.luminaires = NULL;
  WRONG(mrv_scene_generate_with("cubes", &generate, &s), "`options.count` 1099511627776");
  generate.count = 0;
  generate.light_size = -1;
  WRONG(mrv_scene_generate_with("cubes", &generate, &s), "`options.light_size` -1");
  load.emitter_watts = &nan_watts;
  CHECK(mrv_scene_load("a.obj", &load, &s) != MRV_OK);
  WRONG(mrv_scene_from_memory(NULL, 5, "obj", NULL, NULL, &s), "data");
  WRONG(mrv_scene_from_memory("v 0 0", 5, "doc", NULL, NULL, &s), "format");
  WRONG(mrv_scene_from_memory("v 0 0", 5, "obj", NULL, NULL, &s), "memory.obj");
  memset(&solve, 0, sizeof solve);
  solve.struct_size = sizeof solve;
  REFUSED(solve.engine, -1, mrv_model_solve(model, &solve, &l), "engine` -1");
  REFUSED(solve.error, NAN, mrv_model_solve(model, &solve, &l), "`options.error` NaN");
  solve.min_area = -2;
  WRONG(mrv_model_solve(model, &solve, &l), "`options.min_area` -2");
  REFUSED(solve.min_area, 1e-10, mrv_model_solve(model, &solve, &l), "`options.min_area` 1e-10");
  REFUSED(solve.max_links, UINT64_MAX, mrv_model_solve(model, &solve, &l), "`options.max_links`");
  REFUSED(solve.max_seconds, -1, mrv_model_solve(model, &solve, &l), "`options.max_seconds` -1");
  REFUSED(solve.audit, UINT32_MAX, mrv_model_solve(model, &solve, &l), "`options.audit`");
  REFUSED(solve.light_rays, UINT32_MAX, mrv_model_solve(model, &solve, &l), "`options.light_rays`");
  REFUSED(solve.gather_rays, UINT32_MAX, mrv_model_solve(model, &solve, &l), "`options.gather_rays`");
  REFUSED(solve.feature_size, -3, mrv_model_solve(model, &solve, &l), "`options.feature_size` -3");
  solve.feature_size_names = floor_name;
  solve.feature_sizes = &negative;
  REFUSED(solve.feature_size_count, 1, mrv_model_solve(model, &solve, &l), "`options.feature_sizes` -1 of `floor`");
  solve.importance = names;
  solve.importance_count = 1;
  WRONG(mrv_model_solve(model, &solve, &l), "no such");
  memset(&factors, 0, sizeof factors);
  factors.struct_size = sizeof factors;
  REFUSED(factors.grouping, 5, mrv_model_form_factors(model, &factors, &f), "grouping` 5");
  REFUSED(factors.pair_rays, 1, mrv_model_form_factors(model, &factors, &f), "`options.pair_rays` 1");
  factors.max_bytes = 1;
  CHECK(mrv_model_form_factors(model, &factors, &f) == MRV_ERROR_OUT_OF_MEMORY);
  puts(mrv_error_message());
  CHECK(strstr(mrv_error_message(), "raise `options.max_bytes` (now 1)") != NULL);
  CHECK(strcmp(mrv_status_name(12345), "unknown") == 0 && strcmp(mrv_status_name(3), "MRV_ERROR_OUT_OF_MEMORY") == 0);
}

static void handles(void) {
  mrv_scene *s;
  mrv_scene_info info = {sizeof info, 0, 0, 0, 0, 0, 0, 0, {0}, {0}, {0}};
  mrv_model *m;
  mrv_prepare_options rays = {sizeof rays, MRV_DETAIL_RAYS, 1, NULL, NULL, NULL, 0, 0};
  char memory[64] = {0};
  OK(mrv_scene_generate("cornell", &s));
  OK(mrv_model_prepare(s, &rays, &m));
  WRONG(mrv_scene_get_info((const mrv_scene *)(const void *)m, &info), "mrv_model");
  mrv_scene_release((const mrv_scene *)(const void *)m);
  OK(mrv_scene_retain(s));
  mrv_scene_release(s);
  mrv_scene_release(s);
  WRONG(mrv_scene_get_info(s, &info), "released");
  mrv_scene_release(s);
  WRONG(mrv_scene_retain(s), "released");
  WRONG(mrv_scene_get_info((const mrv_scene *)(const void *)memory, &info), "no live handle");
  WRONG(mrv_scene_get_info((const mrv_scene *)(const void *)(memory + 1), &info), "no live handle");
  /* A handle that was released does not become another object's, however many are made. */
  const mrv_scene *released = s;
  for (int i = 0; i < 100; i++) {
    mrv_scene *next;
    OK(mrv_scene_generate("cornell", &next));
    CHECK(next != released);
    WRONG(mrv_scene_get_info(released, &info), "released");
    mrv_scene_release(released);
    OK(mrv_scene_get_info(next, &info));
    mrv_scene_release(next);
  }
  OK(mrv_model_get_scene(m, &s));
  mrv_model_release(m);
  OK(mrv_scene_get_info(s, &info));
  CHECK(info.triangles > 0);
  mrv_scene_release(s);
}

enum { GUARD = 64 };

/* An array between two stretches of a pattern. */
static unsigned char *guarded(size_t bytes) {
  unsigned char *all = (unsigned char *)malloc(bytes + 2 * GUARD);
  CHECK(all != NULL);
  memset(all, 0xA5, bytes + 2 * GUARD);
  return all + GUARD;
}

/* Whether the pattern is still there; with `whole` also in the array. */
static int is_untouched(const unsigned char *array, size_t bytes, int whole) {
  for (size_t i = 0; i < bytes + 2 * GUARD; i++)
    if ((whole || i < GUARD || i >= bytes + GUARD) && array[(ptrdiff_t)i - GUARD] != 0xA5) return 0;
  return 1;
}

static mrv_answers guarded_answers(void) {
  mrv_answers answers = {sizeof answers, NULL, NULL, NULL, NULL, NULL};
  answers.transmittance = (float *)(void *)guarded(BUNDLES * sizeof(float));
  answers.lo = (float *)(void *)guarded(BUNDLES * sizeof(float));
  answers.hi = (float *)(void *)guarded(BUNDLES * sizeof(float));
  answers.methods = guarded(BUNDLES);
  answers.segment_transmittance = (float *)(void *)guarded(SEGMENTS * sizeof(float));
  return answers;
}

static int answers_untouched(const mrv_answers *a, int whole) {
  return is_untouched((unsigned char *)a->transmittance, BUNDLES * sizeof(float), whole) &&
         is_untouched((unsigned char *)a->lo, BUNDLES * sizeof(float), whole) &&
         is_untouched((unsigned char *)a->hi, BUNDLES * sizeof(float), whole) && is_untouched(a->methods, BUNDLES, whole) &&
         is_untouched((unsigned char *)a->segment_transmittance, SEGMENTS * sizeof(float), whole);
}

static void free_answers(const mrv_answers *a) {
  free((unsigned char *)a->transmittance - GUARD);
  free((unsigned char *)a->lo - GUARD);
  free((unsigned char *)a->hi - GUARD);
  free(a->methods - GUARD);
  free((unsigned char *)a->segment_transmittance - GUARD);
}

static void batches(void) {
  static batch b;
  mrv_segments good, bad;
  const mrv_answers answers = guarded_answers();
  mrv_answers some;
  mrv_cost cost = {sizeof cost, 1, 2, 3, 4, 5, 6};
  int again;
  fill_batch(&b);
  good = packed(&b);
  for (again = 0; again < 2; again++) {
    WRONG(mrv_visibility_answer(model, 17, &good, &answers, &cost), "engine` 17");
#define TRY(change, word)                                                                          \
  do {                                                                                             \
    bad = good;                                                                                    \
    change;                                                                                        \
    WRONG(mrv_visibility_answer(model, MRV_ENGINE_MULTI_RESOLUTION, &bad, &answers, &cost), word); \
    CHECK(answers_untouched(&answers, 1) && cost.segments == 1 && cost.certified == 6);            \
  } while (0)
    TRY(bad.origins.x = NULL, "origins.x");
    TRY(bad.origins.y = b.origins, "origins.z");
    TRY(bad.targets.stride = 7, "stride` 7");
    TRY(bad.targets.stride = 8, "stride` 8");
    TRY(bad.targets.stride = SIZE_MAX - 3, "stride");
    TRY(bad.segment_count = UINT64_MAX, "memory");
    TRY(bad.segment_count = SEGMENTS - 1, "`segments.offsets`: the first");
    TRY(bad.bundle_count = UINT64_MAX, "offsets");
    TRY(bad.bundle_count = 0, "`segments.offsets`: the first");
    TRY(bad.offsets = NULL, "offsets");
    TRY(bad.origins.x = (const float *)(const void *)((const char *)b.origins + 1), "multiple of 4");
    TRY(bad.feature_sizes = NULL, "`segments.feature_size`: the engine MRV_ENGINE_MULTI_RESOLUTION");
    TRY((bad.feature_sizes = NULL, bad.feature_size = -1), "`segments.feature_size` -1");
    TRY((bad.emitter_sizes = NULL, bad.emitter_size = NAN), "`segments.emitter_size` NaN");
    TRY(bad.relative_to[1] = INFINITY, "`segments.relative_to`");
    TRY((bad.origins.y = b.origins, bad.origins.stride = MRV_SAME_POSITION), "origins.z");
    TRY(bad.feature_sizes = answers.lo, "overlap");
    TRY(bad.struct_size = 20, "struct_size` 20");
    b.offsets[3] = 1000000;
    TRY((void)0, "`segments.offsets`[4]");
    b.offsets[3] = 3 * RAYS;
    b.targets[5] = NAN;
    TRY((void)0, "`segments.targets`[1]");
    memcpy(b.targets + 3, b.origins + 3, 3 * sizeof(float));
    TRY((void)0, "no length");
    fill_batch(&b);
    b.feature_sizes[1] = -1;
    TRY((void)0, "`segments.feature_sizes`[1] -1");
    fill_batch(&b);
  }
  some = answers;
  some.hi = NULL;
  WRONG(mrv_visibility_answer(model, 0, &good, &some, NULL), "hi");
  some = answers;
  some.lo = some.transmittance + 1;
  WRONG(mrv_visibility_answer(model, 0, &good, &some, NULL), "overlap");
  CHECK(answers_untouched(&answers, 1));
  for (int32_t engine = 0; engine <= MRV_ENGINE_AVERAGE; engine++) {
    OK(mrv_visibility_answer(model, engine, &good, &answers, &cost));
    CHECK(answers_untouched(&answers, 0) && cost.segments == SEGMENTS && !is_untouched(answers.methods, BUNDLES, 1));
  }
  bad = good;
  bad.segment_count = bad.bundle_count = 0;
  bad.offsets = NULL;
  bad.origins.x = bad.targets.x = bad.feature_sizes = bad.emitter_sizes = NULL;
  OK(mrv_visibility_answer(model, 0, &bad, &answers, NULL));
  CHECK(answers.transmittance[0] == 1.0f);
  bad = good;
  bad.origins.stride = MRV_SAME_POSITION;
  OK(mrv_visibility_answer(model, MRV_ENGINE_EXACT, &bad, &answers, NULL));
  free_answers(&answers);
}

/* If one array of elements is wrong, none is written. */
static void no_element_of_wrong_arrays(const mrv_solution *light) {
  mrv_solution_info about;
  mrv_elements to;
  size_t bytes;
  unsigned char *places;
  memset(&about, 0, sizeof about);
  memset(&to, 0, sizeof to);
  about.struct_size = sizeof about;
  to.struct_size = sizeof to;
  OK(mrv_solution_get_info(light, &about));
  bytes = (size_t)about.vertices * 3 * sizeof(double);
  places = guarded(bytes);
  to.vertex_capacity = about.vertices;
  to.element_capacity = about.elements;
  to.positions = (double *)(void *)places;
  to.irradiance = (float *)(void *)(places + 1);
  WRONG(mrv_solution_get_elements(light, &to), "irradiance");
  CHECK(is_untouched(places, bytes, 1));
  to.irradiance = (float *)(void *)places;
  WRONG(mrv_solution_get_elements(light, &to), "overlap");
  CHECK(is_untouched(places, bytes, 1));
  to.irradiance = NULL;
  OK(mrv_solution_get_elements(light, &to));
  CHECK(is_untouched(places, bytes, 0));
  free(places - GUARD);
}

static void queries_and_points(void) {
  mrv_query query;
  mrv_answer answer = {sizeof answer, 9, 9, 9, 9};
  mrv_solve_options options;
  mrv_solution *light;
  const char *text;
  double at[6] = {.2, .2, 0, NAN, 0, 0};
  const double normals[6] = {0, 0, 1, 0, 0, 1};
  unsigned char *out = guarded(6 * sizeof(double));
  memset(&query, 0, sizeof query);
  query.struct_size = sizeof query;
  WRONG(mrv_visibility_query(model, 0, &query, &answer, NULL), "`query.normal`");
  query.normal[2] = 1;
  query.source = 99;
  WRONG(mrv_visibility_query(model, 0, &query, &answer, NULL), "`query.source` 99");
  REFUSED(query.source, UINT64_MAX, mrv_visibility_query(model, 0, &query, &answer, NULL), "`query.source`");
  REFUSED(query.target, 4, mrv_visibility_query(model, 0, &query, &answer, NULL), "target` 4");
  query.position[0] = NAN;
  WRONG(mrv_visibility_query(model, 0, &query, &answer, NULL), "`query.position`");
  query.position[0] = 1e300;
  WRONG(mrv_visibility_query(model, 0, &query, &answer, NULL), "`query.position` [1e300");
  query.position[0] = 0;
  query.target = MRV_TARGET_POINT;
  query.point[1] = INFINITY;
  WRONG(mrv_visibility_query(model, 0, &query, &answer, NULL), "`query.point`");
  query.target = 0;
  query.position[0] = 0;
  REFUSED(query.feature_size, -1, mrv_visibility_query(model, 0, &query, &answer, NULL), "`query.feature_size` -1");
  query.rays = 1u << 30;
  WRONG(mrv_visibility_query(model, 0, &query, &answer, NULL), "`query.rays`");
  CHECK(answer.transmittance == 9 && answer.method == 9);
  memset(&options, 0, sizeof options);
  options.struct_size = sizeof options;
  options.error = .5;
  OK(mrv_model_solve(model, &options, &light));
  WRONG(mrv_solution_irradiance(light, at, normals, 2, (double *)(void *)out), "`positions`[1]");
  at[3] = 1e300;
  WRONG(mrv_solution_irradiance(light, at, normals, 2, (double *)(void *)out), "`positions`[1] [1e300, 0.0, 0.0]: must be finite, at most");
  WRONG(mrv_model_reference(model, at, normals, 2, NULL, (double *)(void *)out, NULL), "`positions`[1] [1e300");
  WRONG(mrv_solution_irradiance(light, normals, at + 1, 1, (double *)(void *)out), "`normals`[0]");
  WRONG(mrv_solution_irradiance(light, at, normals, 2, at), "overlap");
  WRONG(mrv_solution_get_warning(light, 99, &text), "`index` 99");
  WRONG(mrv_solution_write(light, "a.doc", NULL, NULL), "`path` a.doc: the extension must be .vtu");
  WRONG(mrv_solution_irradiance(light, at, NULL, 2, (double *)(void *)out), "normals");
  WRONG(mrv_solution_irradiance(light, at, normals, SIZE_MAX / 16, (double *)(void *)out), "positions");
  CHECK(is_untouched(out, 6 * sizeof(double), 1));
  at[3] = .5;
  OK(mrv_solution_irradiance(light, at, normals, 2, (double *)(void *)out));
  CHECK(is_untouched(out, 6 * sizeof(double), 0));
  OK(mrv_solution_irradiance(light, NULL, NULL, 0, NULL));
  no_element_of_wrong_arrays(light);
  mrv_solution_release(light);
  free(out - GUARD);
}

/* Form factors of a scene with an instance: only of the flat scene. */
static void flattened(const mrv_scene *placed) {
  mrv_scene *flat, *copy;
  mrv_model *m;
  mrv_form_factors *f;
  mrv_scene_info info = {sizeof info, 0, 0, 0, 0, 0, 0, 0, {0}, {0}, {0}};
  const mrv_prepare_options rays = {sizeof rays, MRV_DETAIL_RAYS, 1, NULL, NULL, NULL, 0, 0};
  OK(mrv_model_prepare(placed, &rays, &m));
  WRONG(mrv_model_form_factors(m, NULL, &f), "placed");
  mrv_model_release(m);
  WRONG(mrv_scene_flatten(NULL, 0, &flat), "scene");
  WRONG(mrv_scene_flatten(placed, 0, NULL), "flat");
  WRONG(mrv_scene_flatten(placed, 1, &flat), "1");
  WRONG(mrv_scene_with_sky(placed, "cie:17", NULL, NULL, NULL, &flat), "17 is no type of CIE sky");
  WRONG(mrv_scene_with_sky(placed, "perez:500,100", NULL, NULL, NULL, &flat), "sun");
  WRONG(mrv_scene_with_sky(placed, "uniform", "0,95", NULL, NULL, &flat), "95");
  WRONG(mrv_scene_with_sky(NULL, "uniform", NULL, NULL, NULL, &flat), "scene");
  WRONG(mrv_scene_with_sky(placed, "uniform", NULL, NULL, NULL, NULL), "lit");
  OK(mrv_scene_flatten(placed, 0, &flat));
  OK(mrv_scene_get_info(flat, &info));
  CHECK(info.triangles == 2 && info.visible == 2);
  /* A scene without placed meshes is copied. */
  OK(mrv_scene_flatten(flat, 0, &copy));
  mrv_scene_release(flat);
  OK(mrv_scene_get_info(copy, &info));
  CHECK(info.triangles == 2 && info.visible == 2);
  flat = copy;
  OK(mrv_model_prepare(flat, &rays, &m));
  OK(mrv_model_form_factors(m, NULL, &f));
  mrv_form_factors_release(f);
  mrv_model_release(m);
  mrv_scene_release(flat);
}

static void builders(void) {
  mrv_scene_builder *b;
  mrv_scene *s = NULL;
  mrv_mesh mesh, bad;
  float at[9] = {0, 0, 0, 1, 0, 0, 0, 1, 0};
  uint32_t corners[3] = {0, 1, 2}, materials[1] = {7}, sizes[1] = {2}, index = 42;
  const float wrong[3] = {2, 0, 0};
  double transform[12] = {1, 0, 0, 0, 0, 5, 0, 0, 0, 0, 1, 0};
  OK(mrv_scene_builder_create(&b));
  WRONG(mrv_scene_builder_finish(b, NULL, &s), "");
  WRONG(mrv_scene_builder_add_material(b, "a", wrong, NULL, &index), "reflectance");
  CHECK(index == 42 && s == NULL);
  OK(mrv_scene_builder_add_material(b, "a", NULL, NULL, &index));
  WRONG(mrv_scene_builder_add_material(b, "a", NULL, NULL, &index), "taken");
  memset(&mesh, 0, sizeof mesh);
  mesh.struct_size = sizeof mesh;
  mesh.name = "m";
  mesh.positions = at;
  mesh.vertex_count = 3;
  mesh.indices = corners;
  mesh.index_count = 3;
#define TRY_MESH(change, word)                         \
  do {                                                 \
    bad = mesh;                                        \
    change;                                            \
    WRONG(mrv_scene_builder_add_object(b, &bad), word); \
  } while (0)
  TRY_MESH(bad.name = NULL, "`mesh.name`");
  TRY_MESH(bad.name = "", "name");
  TRY_MESH(bad.positions = NULL, "positions");
  TRY_MESH(bad.positions_f64 = transform, "positions_f64");
  TRY_MESH(bad.position_stride = 5, "position_stride` 5");
  TRY_MESH(bad.vertex_count = 2, "`mesh.indices`[2] 2");
  TRY_MESH(bad.vertex_count = SIZE_MAX, "vertex_count");
  TRY_MESH(bad.indices = NULL, "indices");
  TRY_MESH(bad.index_count = 2, "indices");
  TRY_MESH(bad.index_count = SIZE_MAX, "indices");
  TRY_MESH(bad.index_count = 0, "indices");
  TRY_MESH(bad.material = 9, "`mesh.material`");
  TRY_MESH(bad.face_materials = materials, "face_materials");
  TRY_MESH((bad.polygon_sizes = sizes, bad.polygon_count = 1), "polygon_sizes");
  TRY_MESH((bad.polygon_sizes = sizes, bad.polygon_count = SIZE_MAX), "polygon_sizes");
  TRY_MESH(bad.polygon_count = 4, "polygon_count");
  TRY_MESH(bad.reserved = 1, "reserved");
  at[4] = NAN;
  TRY_MESH((void)0, "`mesh.positions`[1]");
  at[4] = 0;
  OK(mrv_scene_builder_add_shared_mesh(b, &mesh, &index));
  WRONG(mrv_scene_builder_add_instance(b, index, "i", transform), "transform");
  transform[5] = 1;
  WRONG(mrv_scene_builder_add_instance(b, index + 1, "i", transform), "mesh");
  OK(mrv_scene_builder_add_object(b, &mesh));
  WRONG(mrv_scene_builder_add_object(b, &mesh), "taken");
  transform[3] = 2;
  const double nothing[12] = {0};
  WRONG(mrv_scene_builder_add_instance(b, index, "i", nothing), "scale must not be 0");
  OK(mrv_scene_builder_add_instance(b, index, "i", transform));
  OK(mrv_scene_builder_finish(b, NULL, &s));
  flattened(s);
  mrv_scene_release(s);
  mrv_scene_builder_release(b);
}

static void images(void) {
  float texels[16], noisy[16];
  const double sizes[2] = {0, 1}, bad_sizes[1] = {-1};
  unsigned char *errors = guarded(2 * sizeof(double)), *masked = guarded(2 * sizeof(double));
  double *e = (double *)(void *)errors, *m = (double *)(void *)masked;
  mrv_fbem_images good, bad;
  for (int i = 0; i < 16; i++) texels[i] = noisy[i] = (float)(i % 3);
  memset(&good, 0, sizeof good);
  good.struct_size = sizeof good;
  good.reference = texels;
  good.approximation = noisy;
  good.width = good.height = 4;
#define TRY_IMAGES(change, word)                       \
  do {                                                 \
    bad = good;                                        \
    change;                                            \
    WRONG(mrv_fbem(&bad, sizes, 2, e, m), word);       \
  } while (0)
  TRY_IMAGES(bad.reference = NULL, "reference");
  TRY_IMAGES(bad.approximation = NULL, "approximation");
  TRY_IMAGES(bad.width = 0, "`images.reference`: an image of 0 x ");
  TRY_IMAGES(bad.width = bad.height = UINT64_MAX, "reference");
  TRY_IMAGES(bad.texel = -1, "`images.texel` -1");
  TRY_IMAGES(bad.white = -1, "`images.white` -1");
  TRY_IMAGES(bad.threshold = 2, "`images.threshold` 2");
  TRY_IMAGES(bad.exponent = NAN, "`images.exponent` NaN");
  TRY_IMAGES(bad.features = 3, "features` 3");
  TRY_IMAGES(bad.morphology = -2, "morphology` -2");
  TRY_IMAGES(bad.reserved = 2, "reserved");
  noisy[5] = NAN;
  TRY_IMAGES((void)0, "`images.approximation`: texel 1,1");
  noisy[5] = 2;
  WRONG(mrv_fbem(&good, bad_sizes, 1, e, m), "`sizes` -1");
  WRONG(mrv_fbem(&good, sizes, 2, NULL, m), "errors");
  WRONG(mrv_fbem(&good, NULL, 2, e, m), "sizes");
  CHECK(is_untouched(errors, 2 * sizeof(double), 1) && is_untouched(masked, 2 * sizeof(double), 1));
  OK(mrv_fbem(&good, sizes, 2, e, m));
  CHECK(is_untouched(errors, 2 * sizeof(double), 0) && is_untouched(masked, 2 * sizeof(double), 0) && e[0] == 0);
  OK(mrv_fbem(&good, sizes, 2, e, NULL));
  free(errors - GUARD);
  free(masked - GUARD);
}

static int32_t stop_at_once(void *user, const char *stage, double done) {
  (void)stage;
  (void)done;
  ++*(int *)user;
  return 1;
}

/* Cancels what shows or measures light. */
static void stop_showing(const mrv_solution *light, int *calls) {
  static float radiance[3 * 8 * 6];
  const double at[3] = {.3, .3, 0}, normal[3] = {0, 0, 1};
  const double negative = -1;
  double irradiance[3] = {7, 7, 7};
  mrv_camera camera = {sizeof camera, {0}, {0}, {0}, 0}, bad;
  mrv_image_options small = {sizeof small, 8, 6, 0, 0, NULL, NULL};
  const mrv_image_options image = {sizeof image, 8, 6, 0, 0, stop_at_once, calls};
  const mrv_lightmap_options texels = {sizeof texels, 4096, stop_at_once, calls};
  const mrv_reference_options reference = {sizeof reference, 0, 0, 0, stop_at_once, calls};
  mrv_bench_options bench;
  mrv_bench_report *report = NULL;
  mrv_lightmap *map = NULL;
  CHECK(mrv_solution_lightmap(light, &texels, &map) == MRV_ERROR_CANCELLED && map == NULL);
  OK(mrv_solution_get_camera(light, &camera));
  CHECK(mrv_solution_image(light, &camera, &image, radiance, 3 * 8 * 6) == MRV_ERROR_CANCELLED && radiance[0] == 0);
  CHECK(mrv_model_reference(model, at, normal, 1, &reference, irradiance, NULL) == MRV_ERROR_CANCELLED && irradiance[0] == 7);
  memset(&bench, 0, sizeof bench);
  bench.struct_size = sizeof bench;
  REFUSED(bench.audit, NAN, mrv_model_bench(model, &bench, &report), "`options.audit` NaN");
  REFUSED(bench.threads, 1u << 20, mrv_model_bench(model, &bench, &report), "`options.threads` 1048576");
  REFUSED(bench.reference_rays, 1u << 20, mrv_model_bench(model, &bench, &report), "`options.reference_rays` 1048576");
  bench.feature_sizes = &negative;
  REFUSED(bench.feature_size_count, 1, mrv_model_bench(model, &bench, &report), "`options.feature_sizes` -1");
  REFUSED(bench.max_memory, 1, mrv_model_bench(model, &bench, &report), "raise `options.max_memory`");
  bench.progress = stop_at_once;
  bench.user = calls;
  CHECK(mrv_model_bench(model, &bench, &report) == MRV_ERROR_CANCELLED && report == NULL);
  bad = camera;
  bad.angle = 180;
  WRONG(mrv_solution_image(light, &bad, &small, radiance, 3 * 8 * 6), "`camera.angle` 180");
  bad = camera;
  bad.eye[1] = 1e300;
  WRONG(mrv_solution_image(light, &bad, &small, radiance, 3 * 8 * 6), "`camera.eye`");
  small.width = 0;
  WRONG(mrv_solution_image(light, &camera, &small, radiance, 3 * 8 * 6), "`options.width`");
  WRONG(mrv_solution_image(light, &camera, NULL, radiance, 1), "radiance");
  CHECK(*calls == 7);
}

static void cancelling(void) {
  int calls = 0;
  mrv_model *m = NULL;
  mrv_solution *light;
  mrv_form_factors *f = NULL;
  mrv_solution_info info = {sizeof info, 0, 0, {0}, 0, 0, 0, 0};
  mrv_prepare_options prepare = {sizeof prepare, 0, 0, NULL, stop_at_once, &calls, 0, 0};
  mrv_form_factor_options factors;
  mrv_solve_options solve;
  CHECK(mrv_model_prepare(scene, &prepare, &m) == MRV_ERROR_CANCELLED && m == NULL && calls == 1);
  memset(&factors, 0, sizeof factors);
  factors.struct_size = sizeof factors;
  factors.progress = stop_at_once;
  factors.user = &calls;
  CHECK(mrv_model_form_factors(model, &factors, &f) == MRV_ERROR_CANCELLED && f == NULL && calls == 2);
  memset(&solve, 0, sizeof solve);
  solve.struct_size = sizeof solve;
  solve.progress = stop_at_once;
  solve.user = &calls;
  OK(mrv_model_solve(model, &solve, &light));
  OK(mrv_solution_get_info(light, &info));
  CHECK(info.interrupted && calls == 3);
  stop_showing(light, &calls);
  mrv_solution_release(light);
}

static batch shared_batch;
static float expected[BUNDLES];

static void *ask(void *unused) {
  (void)unused;
  for (int i = 0; i < 20; i++) {
    float found[BUNDLES];
    const mrv_segments segments = packed(&shared_batch);
    const mrv_answers answers = {sizeof answers, found, NULL, NULL, NULL, NULL};
    mrv_scene *own;
    OK(mrv_model_retain(model));
    OK(mrv_visibility_answer(model, MRV_ENGINE_MULTI_RESOLUTION, &segments, &answers, NULL));
    CHECK(memcmp(found, expected, sizeof found) == 0);
    CHECK(mrv_visibility_answer(model, -1, &segments, &answers, NULL) == MRV_ERROR_INPUT);
    CHECK(strstr(mrv_error_message(), "engine` -1") != NULL);
    OK(mrv_model_get_scene(model, &own));
    mrv_scene_release(own);
    mrv_model_release(model);
  }
  return NULL;
}

static void threads(void) {
  pthread_t all[8];
  mrv_segments segments;
  const mrv_answers answers = {sizeof answers, expected, NULL, NULL, NULL, NULL};
  fill_batch(&shared_batch);
  segments = packed(&shared_batch);
  OK(mrv_visibility_answer(model, MRV_ENGINE_MULTI_RESOLUTION, &segments, &answers, NULL));
  for (int i = 0; i < 8; i++) CHECK(pthread_create(&all[i], NULL, ask, NULL) == 0);
  for (int i = 0; i < 8; i++) CHECK(pthread_join(all[i], NULL) == 0);
}

static void float_state(void) {
#if defined(__x86_64__)
  static float flushed[BUNDLES];
  const mrv_segments segments = packed(&shared_batch);
  const mrv_answers answers = {sizeof answers, flushed, NULL, NULL, NULL, NULL};
  const unsigned usual = _mm_getcsr(), own = (usual | 0x8040u | 0x6000u); /* flush, zero, round towards zero */
  _mm_setcsr(own);
  const mrv_status status = mrv_visibility_answer(model, MRV_ENGINE_MULTI_RESOLUTION, &segments, &answers, NULL);
  const unsigned after = _mm_getcsr();
  const mrv_status refused = mrv_visibility_answer(model, -1, &segments, &answers, NULL);
  const unsigned later = _mm_getcsr();
  _mm_setcsr(usual);
  CHECK(status == MRV_OK && refused == MRV_ERROR_INPUT && after == own && later == own);
  CHECK(memcmp(flushed, expected, sizeof flushed) == 0);
#endif
}

/* Bytes of this process in memory. */
static long resident(void) {
  long pages = 0, all = 0;
  FILE *file = fopen("/proc/self/statm", "r");
  if (file == NULL) return 0;
  if (fscanf(file, "%ld %ld", &all, &pages) != 2) pages = 0;
  fclose(file);
  return pages * sysconf(_SC_PAGESIZE);
}

/* One life of a scene, with a model for every hundredth. */
static void live(int i) {
  const float at[9] = {0, 0, 0, 1, 0, 0, 0, 1, 0};
  const uint32_t corners[3] = {0, 1, 2};
  mrv_prepare_options rays = {sizeof rays, MRV_DETAIL_RAYS, 1, NULL, NULL, NULL, 0, 0};
  mrv_load_options load;
  mrv_scene_builder *b;
  mrv_scene *s;
  mrv_model *m = NULL;
  mrv_mesh mesh;
  memset(&load, 0, sizeof load);
  load.struct_size = sizeof load;
  load.unit = "cm";
  load.threads = 1;
  memset(&mesh, 0, sizeof mesh);
  mesh.struct_size = sizeof mesh;
  mesh.name = "m";
  mesh.positions = at;
  mesh.vertex_count = 3;
  mesh.indices = corners;
  mesh.index_count = 3;
  OK(mrv_scene_builder_create(&b));
  OK(mrv_scene_builder_add_material(b, "a", NULL, NULL, NULL));
  CHECK(mrv_scene_builder_add_material(b, "a", NULL, NULL, NULL) == MRV_ERROR_INPUT);
  OK(mrv_scene_builder_add_object(b, &mesh));
  if (i % 100 == 0) {
    const char *name;
    OK(mrv_scene_builder_finish(b, &load, &s));
    OK(mrv_scene_get_name(s, MRV_NAME_OBJECT, 0, &name));
    OK(mrv_model_prepare(s, &rays, &m));
    mrv_scene_release(s);
    mrv_model_release(m);
  }
  mrv_scene_builder_release(b);
}

static void growth(int lives) {
  long before, after, allowed = 1500000;
#ifdef __SANITIZE_ADDRESS__
  allowed = 1L << 40; /* it holds freed blocks back, and finds by itself what is lost */
#endif
  for (int i = 0; i < lives / 5; i++) live(i);
  before = resident();
  for (int i = 0; i < lives; i++) live(i);
  after = resident();
  /* A handle of 200 bytes that stayed in each life would be 2 MB, a thread or a model in each hundredth far more. */
  if (after - before > allowed) {
    fprintf(stderr, "memory grew by %ld bytes\n", after - before);
    exit(1);
  }
}

int main(int count, char **arguments) {
  const int lives = count > 1 ? atoi(arguments[1]) : 10000;
  const mrv_prepare_options options = {sizeof options, MRV_DETAIL_OPTICS, 2, NULL, NULL, NULL, 0, 0};
  mrv_scene *s = box_scene();
  mrv_model *m;
  CHECK(strcmp(mrv_error_message(), "") == 0);
  OK(mrv_model_prepare(s, &options, &m));
  scene = s;
  model = m;
  nulls();
  sizes_and_numbers();
  handles();
  batches();
  queries_and_points();
  builders();
  images();
  cancelling();
  threads();
  /* Valgrind does not have the processor's modes for denormal numbers. */
  if (lives > 0) float_state();
  mrv_scene_release(s);
  growth(lives);
  mrv_model_release(m);
  return 0;
}
