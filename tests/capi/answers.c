/* Prints what the library answers, bit by bit; tests/suite/capi compares it with the answers of the crate. */
#include "common.h"

static void print_scene(const mrv_scene *scene) {
  mrv_scene_info info = {sizeof info, 0, 0, 0, 0, 0, 0, 0, {0}, {0}, {0}};
  const char *name;
  char unit[8];
  OK(mrv_scene_get_info(scene, &info));
  OK(mrv_scene_get_unit(scene, unit, sizeof unit));
  printf("scene %d %d %d %d %d %d %s\n", (int)info.triangles, (int)info.visible, (int)info.objects, (int)info.materials,
         (int)info.emitters, (int)info.repairs, unit);
  for (int i = 0; i < 3; i++)
    printf("bounds %016llx %016llx %016llx\n", bits_f64(info.low[i]), bits_f64(info.high[i]), bits_f64(info.origin[i]));
  for (uint64_t i = 0; i < info.objects; i++) {
    OK(mrv_scene_get_name(scene, MRV_NAME_OBJECT, i, &name));
    printf("object %s\n", name);
  }
  for (uint64_t i = 0; i < info.emitters; i++) {
    OK(mrv_scene_get_name(scene, MRV_NAME_EMITTER, i, &name));
    printf("emitter %s\n", name);
  }
}

static void print_batches(const mrv_model *model) {
  static batch b;
  static float interleaved[8 * SEGMENTS], axes[6][SEGMENTS];
  static float out[3][4][BUNDLES], each[3][SEGMENTS];
  static uint8_t methods[3][BUNDLES];
  fill_batch(&b);
  for (int i = 0; i < SEGMENTS; i++)
    for (int c = 0; c < 3; c++) {
      interleaved[8 * i + c] = axes[c][i] = b.origins[3 * i + c];
      interleaved[8 * i + 4 + c] = axes[3 + c][i] = b.targets[3 * i + c];
    }
  for (int32_t engine = MRV_ENGINE_AUTOMATIC; engine <= MRV_ENGINE_AVERAGE; engine++) {
    mrv_cost cost = {sizeof cost, 0, 0, 0, 0, 0, 0};
    for (int layout = 0; layout < 3; layout++) {
      mrv_segments segments = packed(&b);
      mrv_answers answers = {sizeof answers, out[layout][0], out[layout][1], out[layout][2], methods[layout], each[layout]};
      if (layout == 1) {
        segments.origins.x = interleaved;
        segments.targets.x = interleaved + 4;
        segments.origins.stride = segments.targets.stride = 32;
      } else if (layout == 2) {
        const mrv_positions from = {axes[0], axes[1], axes[2], 0}, to = {axes[3], axes[4], axes[5], 4};
        segments.origins = from;
        segments.targets = to;
      }
      OK(mrv_visibility_answer(model, engine, &segments, &answers, &cost));
    }
    CHECK(!memcmp(out[0], out[1], sizeof out[0]) && !memcmp(out[0], out[2], sizeof out[0]));
    CHECK(!memcmp(methods[0], methods[1], BUNDLES) && !memcmp(methods[0], methods[2], BUNDLES));
    CHECK(!memcmp(each[0], each[1], sizeof each[0]) && !memcmp(each[0], each[2], sizeof each[0]));
    printf("cost %d %d %d %d %d %d\n", (int)cost.segments, (int)cost.nodes, (int)cost.exact_rays, (int)cost.handed_over,
           (int)cost.aggregated, (int)cost.certified);
    for (int k = 0; k < BUNDLES; k++)
      printf("%d %d %08x %08x %08x %d\n", (int)engine, k, bits(out[0][0][k]), bits(out[0][1][k]), bits(out[0][2][k]), methods[0][k]);
    for (int i = 0; i < SEGMENTS; i++) printf("%08x%c", bits(each[0][i]), i % RAYS == RAYS - 1 ? '\n' : ' ');
  }
}

/* One position for all segments, interleaved and in three arrays. */
static void check_same_position(const mrv_model *model) {
  static batch b;
  static float out[2][SEGMENTS];
  float whole[2];
  fill_batch(&b);
  for (int layout = 0; layout < 2; layout++) {
    mrv_segments segments = packed(&b);
    mrv_answers answers = {sizeof answers, whole + layout, NULL, NULL, NULL, out[layout]};
    if (layout == 1) {
      segments.origins.y = segments.origins.x + 1;
      segments.origins.z = segments.origins.x + 2;
    }
    segments.origins.stride = MRV_SAME_POSITION;
    segments.offsets = NULL;
    segments.bundle_count = 1;
    OK(mrv_visibility_answer(model, MRV_ENGINE_EXACT, &segments, &answers, NULL));
  }
  CHECK(whole[0] == whole[1] && memcmp(out[0], out[1], sizeof out[0]) == 0);
}

static void print_queries(const mrv_model *model) {
  mrv_answer answer = {sizeof answer, 0, 0, 0, 0};
  mrv_query query;
  memset(&query, 0, sizeof query);
  query.struct_size = sizeof query;
  query.position[0] = .3;
  query.position[1] = .7;
  query.normal[2] = 2;
  query.feature_size = .3f;
  query.rays = 48;
  OK(mrv_visibility_query(model, MRV_ENGINE_AUTOMATIC, &query, &answer, NULL));
  printf("query %08x %08x %08x %d\n", bits(answer.transmittance), bits(answer.lo), bits(answer.hi), (int)answer.method);
  query.target = MRV_TARGET_POINT;
  query.point[0] = query.point[1] = query.point[2] = .9;
  OK(mrv_visibility_query(model, MRV_ENGINE_EXACT, &query, &answer, NULL));
  printf("query %08x %08x %08x %d\n", bits(answer.transmittance), bits(answer.lo), bits(answer.hi), (int)answer.method);
}

/* A number that stands for an array: FNV-1a. */
static unsigned long long hash(const void *array, size_t bytes) {
  uint64_t number = 14695981039346656037u;
  for (size_t i = 0; i < bytes; i++) number = (number ^ ((const unsigned char *)array)[i]) * 1099511628211u;
  return (unsigned long long)number;
}

static void *room(size_t bytes) {
  void *memory = malloc(bytes + 1);
  CHECK(memory != NULL);
  return memory;
}

static void print_elements(const mrv_solution *solution) {
  mrv_solution_info info = {sizeof info, 0, 0, {0}, 0, 0, 0, 0};
  mrv_elements e;
  size_t n;
  OK(mrv_solution_get_info(solution, &info));
  n = (size_t)info.elements;
  memset(&e, 0, sizeof e);
  e.struct_size = sizeof e;
  e.vertex_capacity = info.vertices;
  e.element_capacity = n;
  e.positions = (double *)room(24 * (size_t)info.vertices);
  e.corners = (uint32_t *)room(16 * n);
  e.irradiance = (float *)room(12 * n);
  e.radiosity = (float *)room(12 * n);
  e.error = (float *)room(12 * n);
  e.reflectance = (float *)room(12 * n);
  e.area = (double *)room(8 * n);
  e.triangle = (uint32_t *)room(4 * n);
  e.object = (uint32_t *)room(4 * n);
  e.material = (uint32_t *)room(4 * n);
  e.front = (uint8_t *)room(n);
  e.exitance = (float *)room(12 * n);
  OK(mrv_solution_get_elements(solution, &e));
  printf("elements %d %d\n", (int)info.vertices, (int)n);
  printf("positions %016llx\ncorners %016llx\n", hash(e.positions, 24 * (size_t)info.vertices), hash(e.corners, 16 * n));
  printf("irradiance %016llx\nradiosity %016llx\n", hash(e.irradiance, 12 * n), hash(e.radiosity, 12 * n));
  printf("error %016llx\nreflectance %016llx\n", hash(e.error, 12 * n), hash(e.reflectance, 12 * n));
  printf("area %016llx\ntriangle %016llx\n", hash(e.area, 8 * n), hash(e.triangle, 4 * n));
  printf("object %016llx\nmaterial %016llx\nfront %016llx\n", hash(e.object, 4 * n), hash(e.material, 4 * n), hash(e.front, n));
  printf("exitance %016llx\n", hash(e.exitance, 12 * n));
  e.element_capacity--;
  CHECK(mrv_solution_get_elements(solution, &e) == MRV_ERROR_INPUT && strstr(mrv_error_message(), "element_capacity"));
  free(e.positions);
  free(e.corners);
  free(e.irradiance);
  free(e.radiosity);
  free(e.error);
  free(e.reflectance);
  free(e.area);
  free(e.triangle);
  free(e.object);
  free(e.material);
  free(e.front);
  free(e.exitance);
}

static void print_images(const mrv_solution *solution) {
  static float radiance[3 * 32 * 24];
  mrv_camera camera = {sizeof camera, {0}, {0}, {0}, 0};
  mrv_image_options options = {sizeof options, 32, 24, 0, 0, NULL, NULL};
  mrv_lightmap_options texels = {sizeof texels, 4096, NULL, NULL};
  mrv_lightmap_arrays a;
  mrv_lightmap *lightmap;
  const char *text, *again;
  OK(mrv_solution_get_camera(solution, &camera));
  OK(mrv_solution_image(solution, &camera, &options, radiance, 3 * 32 * 24));
  printf("image %016llx %016llx\n", hash(camera.eye, sizeof camera.eye), hash(radiance, sizeof radiance));
  CHECK(mrv_solution_image(solution, &camera, &options, radiance, 3 * 32 * 23) == MRV_ERROR_INPUT);
  OK(mrv_solution_lightmap(solution, &texels, &lightmap));
  memset(&a, 0, sizeof a);
  a.struct_size = sizeof a;
  OK(mrv_lightmap_get_arrays(lightmap, &a));
  printf("lightmap %d %d %016llx\n", (int)a.width, (int)a.height, hash(a.irradiance, (size_t)(12 * a.width * a.height)));
  printf("positions %016llx\n", hash(a.positions, (size_t)(24 * a.vertices)));
  printf("corners %016llx\n", hash(a.corners, (size_t)(12 * a.triangles)));
  printf("texcoords %016llx\n", hash(a.texcoords, (size_t)(24 * a.triangles)));
  mrv_lightmap_release(lightmap);
  OK(mrv_solution_get_json(solution, &text));
  CHECK(text[0] == '{' && strstr(text, "\"error_estimate\"") != NULL);
  OK(mrv_solution_get_json(solution, &again));
  CHECK(text == again);
  OK(mrv_solution_get_page(solution, &text));
  CHECK(strstr(text, "</html>") != NULL);
}

static int32_t count_calls(void *user, const char *stage, double done) {
  CHECK(stage != NULL && done <= 1.0);
  ++*(int *)user;
  return 0;
}

static void print_solution(const mrv_model *model) {
  const double positions[6] = {.25, .25, 0, .8, .6, 0}, normals[6] = {0, 0, 1, 0, 0, 5};
  double irradiance[6];
  int calls = 0;
  mrv_solution_info info = {sizeof info, 0, 0, {0}, 0, 0, 0, 0};
  mrv_solve_options options;
  mrv_solution *solution;
  memset(&options, 0, sizeof options);
  options.struct_size = sizeof options;
  options.error = .3;
  options.min_area = 1e-3;
  options.progress = count_calls;
  options.user = &calls;
  OK(mrv_model_solve(model, &options, &solution));
  CHECK(calls >= 2);
  OK(mrv_solution_get_info(solution, &info));
  OK(mrv_solution_irradiance(solution, positions, normals, 2, irradiance));
  printf("solution %016llx %016llx %d\n", bits_f64(info.mean_irradiance[0]), bits_f64(info.error_estimate), (int)info.interrupted);
  for (int i = 0; i < 6; i++) printf("irradiance %016llx\n", bits_f64(irradiance[i]));
  print_elements(solution);
  print_images(solution);
  mrv_solution_release(solution);
}

static void print_form_factors(void) {
  mrv_prepare_options prepare = {sizeof prepare, MRV_DETAIL_RAYS, 1, NULL, NULL, NULL, 0, 0};
  mrv_form_factor_options options;
  mrv_form_factor_arrays a;
  mrv_scene *scene;
  mrv_model *model;
  mrv_form_factors *factors;
  OK(mrv_scene_generate("cornell", &scene));
  OK(mrv_model_prepare(scene, &prepare, &model));
  memset(&options, 0, sizeof options);
  options.struct_size = sizeof options;
  options.grouping = MRV_GROUPING_OBJECT;
  options.rays = 256;
  OK(mrv_model_form_factors(model, &options, &factors));
  mrv_model_release(model);
  mrv_scene_release(scene);
  memset(&a, 0, sizeof a);
  a.struct_size = sizeof a;
  OK(mrv_form_factors_get_arrays(factors, &a));
  printf("factors %d %d %d %016llx\n", (int)a.rows, (int)a.entries, (int)a.rays, bits_f64(a.row_sum_error));
  for (uint64_t row = 0; row < a.rows; row++) {
    const char *name;
    const uint32_t *columns;
    const float *values;
    size_t count;
    OK(mrv_form_factors_get_name(factors, row, &name));
    OK(mrv_form_factors_get_row(factors, row, &columns, &values, &count));
    CHECK(columns == a.columns + a.offsets[row] && values == a.values + a.offsets[row]);
    CHECK(count == a.offsets[row + 1] - a.offsets[row]);
    printf("row %s %016llx %08x %08x\n", name, bits_f64(a.areas[row]), bits(a.escaped[row]), bits(a.lost[row]));
    for (size_t i = 0; i < count; i++) printf("factor %d %08x\n", (int)columns[i], bits(values[i]));
  }
  mrv_form_factors_release(factors);
}

/* A dark square with a bright spot, and the same with noise. */
static void print_fbem(void) {
  static float reference[32 * 32], approximation[32 * 32];
  const double sizes[3] = {0, .5, 4};
  double errors[3], masked[3];
  mrv_fbem_images images;
  random_state = 3;
  for (int i = 0; i < 32 * 32; i++) {
    const int x = i % 32, y = i / 32;
    reference[i] = x > 8 && x < 24 && y > 8 && y < 24 ? (x == 16 && y == 16 ? .75f : .25f) : 1.0f;
    approximation[i] = reference[i] + .125f * draw();
  }
  memset(&images, 0, sizeof images);
  images.struct_size = sizeof images;
  images.reference = reference;
  images.approximation = approximation;
  images.width = images.height = 32;
  images.texel = .25;
  OK(mrv_fbem(&images, sizes, 3, errors, masked));
  for (int i = 0; i < 3; i++) printf("fbem %016llx %016llx\n", bits_f64(errors[i]), bits_f64(masked[i]));
}

static void print_reference(const mrv_model *model) {
  const double positions[6] = {.25, .25, 0, .8, .6, 0}, normals[6] = {0, 0, 1, 0, 0, 5};
  double irradiance[6], errors[6];
  mrv_reference_options options = {sizeof options, 9, 16, 0, NULL, NULL};
  OK(mrv_model_reference(model, positions, normals, 2, &options, irradiance, errors));
  for (int i = 0; i < 6; i++) printf("reference %016llx %016llx\n", bits_f64(irradiance[i]), bits_f64(errors[i]));
}

/* A square over the floor that is placed twice, moved and hidden. */
static void print_updates(void) {
  const float square[12] = {-.5f, -.5f, 0, .5f, -.5f, 0, .5f, .5f, 0, -.5f, .5f, 0}, bottom[12] = {-9, -9, 0, 9, -9, 0, 9, 9, 0, -9, 9, 0};
  const uint32_t corners[6] = {0, 1, 2, 0, 2, 3};
  const double at_one[12] = {1, 0, 0, 0, 0, 1, 0, 0, 0, 0, 1, 1}, at_two[12] = {1, 0, 0, 3, 0, 1, 0, 0, 0, 0, 1, 1};
  const float origins[12] = {0, 0, .5f, 3, 0, .5f, 6, 0, .5f, 9, 0, .5f}, targets[12] = {0, 0, 2, 3, 0, 2, 6, 0, 2, 9, 0, 2};
  float transmittance, each[4];
  mrv_scene_builder *builder;
  mrv_scene *scene;
  mrv_model *model, *updated;
  mrv_mesh mesh;
  mrv_instance_change changes[3];
  mrv_segments segments;
  mrv_instance instance;
  mrv_answers answers = {sizeof answers, &transmittance, NULL, NULL, NULL, each};
  uint32_t index;
  OK(mrv_scene_builder_create(&builder));
  OK(mrv_scene_builder_add_material(builder, "grey", NULL, NULL, NULL));
  memset(&mesh, 0, sizeof mesh);
  mesh.struct_size = sizeof mesh;
  mesh.vertex_count = 4;
  mesh.indices = corners;
  mesh.index_count = 6;
  mesh.name = "bottom";
  mesh.positions = bottom;
  OK(mrv_scene_builder_add_object(builder, &mesh));
  mesh.name = "square";
  mesh.positions = square;
  OK(mrv_scene_builder_add_shared_mesh(builder, &mesh, &index));
  OK(mrv_scene_builder_add_instance(builder, index, "one", at_one));
  OK(mrv_scene_builder_add_instance(builder, index, "two", at_two));
  OK(mrv_scene_builder_finish(builder, NULL, &scene));
  mrv_scene_builder_release(builder);
  OK(mrv_model_prepare(scene, NULL, &model));
  memset(&segments, 0, sizeof segments);
  segments.struct_size = sizeof segments;
  segments.origins.x = origins;
  segments.targets.x = targets;
  segments.segment_count = 4;
  OK(mrv_visibility_answer(model, MRV_ENGINE_EXACT, &segments, &answers, NULL));
  printf("before %g %g %g %g\n", each[0], each[1], each[2], each[3]);
  memset(changes, 0, sizeof changes);
  for (int i = 0; i < 3; i++) changes[i].struct_size = sizeof changes[i];
  memset(&instance, 0, sizeof instance);
  instance.struct_size = sizeof instance;
  OK(mrv_model_get_instance(model, 2, &instance));
  printf("instance %s %g %d\n", instance.name, instance.transform[3], (int)instance.material);
  changes[0].kind = MRV_CHANGE_MOVE;
  changes[0].instance = 2;
  memcpy(changes[0].transform, instance.transform, sizeof instance.transform);
  changes[0].transform[3] += 3;
  changes[1].kind = MRV_CHANGE_HIDE;
  changes[1].instance = 1;
  changes[2] = changes[0];
  changes[2].kind = MRV_CHANGE_ADD;
  changes[2].mesh = 1;
  changes[2].transform[3] += 3;
  changes[2].material = MRV_MATERIAL_KEEP;
  OK(mrv_model_update(model, changes, 3, &updated));
  mrv_model_release(model);
  OK(mrv_visibility_answer(updated, MRV_ENGINE_EXACT, &segments, &answers, NULL));
  printf("after %g %g %g %g\n", each[0], each[1], each[2], each[3]);
  mrv_model_release(updated);
  mrv_scene_release(scene);
}

int main(void) {
  mrv_prepare_options options = {sizeof options, MRV_DETAIL_OPTICS, 2, NULL, NULL, NULL, 0, 0};
  mrv_scene *scene = box_scene();
  mrv_model *model;
  CHECK(mrv_version() == MRV_VERSION);
  print_scene(scene);
  OK(mrv_model_prepare(scene, &options, &model));
  mrv_scene_release(scene);
  print_batches(model);
  check_same_position(model);
  print_queries(model);
  print_solution(model);
  print_reference(model);
  print_fbem();
  mrv_model_release(model);
  print_form_factors();
  print_updates();
  return 0;
}
