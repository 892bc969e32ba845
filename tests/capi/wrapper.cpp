/* The C++ wrapper: handles, errors, spans, progress; the first lines of its answers are those of answers.c. */
#include <mrvis.hpp>

#include <cstdlib>
#include <cstring>
#include <utility>
#include <vector>
#if __cplusplus >= 202002L
#include <span>
#endif

#include "common.h"

static mrv::answers into(std::vector<float> &t, std::vector<float> &lo, std::vector<float> &hi, std::vector<uint8_t> &m) {
  mrv::answers wanted;
  wanted.transmittance = t;
  wanted.lo = lo;
  wanted.hi = hi;
  wanted.methods = m;
  return wanted;
}

static void print_batches(const mrv::model &model) {
  static batch b;
  fill_batch(&b);
  std::vector<float> t(BUNDLES), lo(BUNDLES), hi(BUNDLES), again(BUNDLES);
  std::vector<uint8_t> methods(BUNDLES);
  mrv::segments segments(mrv::span<const float>(b.origins), mrv::span<const float>(b.targets), b.offsets);
  segments.feature_sizes = b.feature_sizes;
  segments.emitter_sizes = b.emitter_sizes;
  for (mrv::engine engine : {mrv::engine::automatic, mrv::engine::exact, mrv::engine::multi_resolution, mrv::engine::average}) {
    (void)model.visibility(engine, segments, into(t, lo, hi, methods));
    for (int k = 0; k < BUNDLES; k++)
      std::printf("%d %d %08x %08x %08x %d\n", static_cast<int>(mrv::number(engine)), k, bits(t[static_cast<size_t>(k)]),
                  bits(lo[static_cast<size_t>(k)]), bits(hi[static_cast<size_t>(k)]), methods[static_cast<size_t>(k)]);
  }
#if __cplusplus >= 202002L
  const std::span<const float> from(b.origins), to(b.targets);
  mrv::segments same(mrv::span<const float>(from), mrv::span<const float>(to), std::span<const uint64_t>(b.offsets));
  same.feature_sizes = b.feature_sizes;
  same.emitter_sizes = b.emitter_sizes;
  mrv::answers wanted;
  wanted.transmittance = std::span<float>(again);
  (void)model.visibility(mrv::engine::average, same, wanted);
  CHECK(std::memcmp(again.data(), t.data(), sizeof(float) * BUNDLES) == 0);
#endif
}

#ifndef MRVIS_NO_EXCEPTIONS

/* The status of what is thrown. */
template <class F>
static mrv::status thrown(F call) {
  try {
    call();
  } catch (const mrv::error &error) {
    CHECK(std::strlen(error.what()) > 0);
    return error.status();
  }
  return mrv::status::ok;
}

static void check_errors(const mrv::model &model) {
  CHECK(thrown([] { mrv::scene::load("/nonexistent/a.obj"); }) == mrv::status::io);
  CHECK(thrown([] { mrv::scene().info(); }) == mrv::status::input);
  mrv::prepare_options options;
  options.detail = 99;
  CHECK(thrown([&] { mrv::model::prepare(model.scene(), options); }) == mrv::status::input);
  CHECK(thrown([&] { mrv::model::prepare(model.scene(), {}, [](const char *, double) { return false; }); }) == mrv::status::cancelled);
  mrv::answers wanted;
  CHECK(thrown([&] { model.visibility(mrv::engine::exact, mrv::segments(mrv::positions(), mrv::positions()), wanted); }) ==
        mrv::status::input);
  const std::vector<float> ten(10), nine(9);
  std::vector<float> one(1);
  wanted.transmittance = one;
  for (const auto &[from, to] : {std::pair(mrv::positions(ten), mrv::positions(nine)),                       // 10 is no multiple of 3
                                 std::pair(mrv::positions(nine), mrv::positions(nine, nine, nine)),          // 3 and 9 positions
                                 std::pair(mrv::positions(ten, ten, nine), mrv::positions(ten, ten, ten))})  // z is short
    CHECK(thrown([&, from = from, to = to] { model.visibility(mrv::engine::exact, mrv::segments(from, to), wanted); }) ==
          mrv::status::input);
  bool is_passed_on = false;
  try {
    model.solve({}, [](const char *, double) -> bool { throw 7; });
  } catch (int number) {
    is_passed_on = number == 7;
  }
  CHECK(is_passed_on);
}

#else

static void check_errors(const mrv::model &model) {
  const auto missing = mrv::scene::load("/nonexistent/a.obj");
  CHECK(!missing && missing.status() == mrv::status::io && !missing.message().empty() && !missing.value());
  const auto stopped = mrv::model::prepare(model.scene().value(), {}, [](const char *, double) { return false; });
  CHECK(!stopped && stopped.status() == mrv::status::cancelled);
  const auto light = model.solve({}, [](const char *, double) { return false; });
  CHECK(light.value().info().value().interrupted);
  const std::array<double, 2> plane = {0, 0};
  const std::array<double, 3> normal = {0, 0, 1};
  for (const std::string &message : {light.value().irradiance(plane, normal).message(), model.reference(plane, plane).message()})
    CHECK(message == "`positions` has 2 entries, must have x, y and z for each point");
}

#endif

/* The value of a result in both modes. */
#ifndef MRVIS_NO_EXCEPTIONS
#define VALUE(call) (call)
#else
#define VALUE(call) ((call).value())
#endif

/* What has no lines of its own in answers.c. */
static void check_measurements(const mrv::model &model) {
  mrv::form_factor_options options;
  options.grouping = mrv::number(mrv::grouping::object);
  options.rays = 64;
  const mrv::form_factors factors = VALUE(model.form_factors(options));
  const mrv::form_factor_arrays all = VALUE(factors.arrays());
  const mrv::form_factor_row row = VALUE(factors.row(1));
  CHECK(row.columns.size() == all.offsets[2] - all.offsets[1] && row.values.data() == all.values + all.offsets[1]);
  const std::array<double, 3> at = {.1, .1, 0}, up = {0, 0, 1};
  mrv::reference_options paths;
  paths.samples = 256;
  const mrv::reference_light light = VALUE(model.reference(at, up, paths));
  CHECK(light.irradiance[0] > 0 && light.standard_errors[0] > 0 && light.standard_errors[0] < light.irradiance[0]);
  paths.direct_only = 1;
  CHECK(VALUE(model.reference(at, up, paths)).irradiance[0] < light.irradiance[0]);
  const std::array<float, 4> white = {1, 1, 1, 1}, shadow = {0, 1, 1, 1};
  mrv::fbem_images images;
  images.reference = white.data();
  images.approximation = shadow.data();
  images.width = images.height = 2;
  const std::array<double, 2> sizes = {0, 1};
  const mrv::fbem_spectrum spectrum = VALUE(mrv::fbem_with_masked(images, sizes));
  CHECK(spectrum.errors == VALUE(mrv::fbem(images, sizes)) && spectrum.masked[0] == 1);
  CHECK(std::string(mrv::status_name(mrv::status::io)) == "MRV_ERROR_IO");
  mrv::generate_options few;
  few.count = 3;
  CHECK(VALUE(VALUE(mrv::scene::generate("cubes", few)).info()).triangles < VALUE(VALUE(mrv::scene::generate("cubes")).info()).triangles);
}

int main() {
  mrv::scene scene(box_scene());
  CHECK(VALUE(scene.info()).emitters == 1 && VALUE(scene.name(mrv::name_kind::emitter, 0)).size() > 0);
  mrv::prepare_options options;
  options.threads = 2;
  int calls = 0;
  mrv::model model = VALUE(mrv::model::prepare(scene, options, [&](const char *, double) { return ++calls > 0; }));
  CHECK(calls > 0);

  mrv::scene copy = scene, moved = std::move(scene);
  CHECK(copy.get() == moved.get() && !scene);
  scene = moved;
  moved = mrv::scene();
  copy = std::move(scene);
  CHECK(copy && !scene && !moved);
  const mrv::model &self = model;
  model = self;
  print_batches(model);
  check_errors(model);

  mrv::query query;
  query.position[0] = .3;
  query.position[1] = .7;
  query.normal[2] = 2;
  mrv::cost cost;
  CHECK(VALUE(model.visibility(mrv::engine::exact, query, &cost)).lo >= 0 && cost.segments > 0);
  check_measurements(model);
  CHECK(mrv::version() == MRV_VERSION && VALUE(mrv::embree_version()).size() > 4);
  mrv_scene_release(copy.release());
  return 0;
}
