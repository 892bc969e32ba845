// Multi-resolution visibility against exact rays, timed here: light of an overcast sky on the ground below many leaves.
//   compare [LEAVES]
#include <mrvis.hpp>

#include <chrono>
#include <cmath>
#include <cstdio>
#include <cstdlib>
#include <random>

static std::minstd_rand generator(1);
static float draw(float low, float high) { return std::uniform_real_distribution<float>(low, high)(generator); }

int main(int count, char **arguments) try {
  const std::size_t leaves = count > 1 ? std::strtoul(arguments[1], nullptr, 10) : 50000, points = 2000, rays = 64;
  if (leaves == 0) return std::fputs("usage: compare [LEAVES]\n", stderr), 2;
  std::vector<float> corners;
  std::vector<uint32_t> indices;
  for (std::size_t i = 0; i < leaves; i++) {
    const float x = draw(0, 10), y = draw(0, 10), z = draw(2, 6);
    for (uint32_t k = 0; k < 3; k++) {
      indices.push_back(static_cast<uint32_t>(corners.size() / 3));
      corners.insert(corners.end(), {x + draw(-.05f, .05f), y + draw(-.05f, .05f), z + draw(-.05f, .05f)});
    }
  }
  mrv::scene_builder builder = mrv::scene_builder::create();
  builder.add_object(mrv::triangles("leaves", corners, indices, builder.add_material("leaf")));
  const mrv::model model = mrv::model::prepare(builder.finish());

  // A bundle is a point of the ground and points all over the sky, a square of 10 m at a height of 10 m.
  std::vector<float> from, to;
  std::vector<uint64_t> bundles{0};
  for (std::size_t point = 0; point < points; point++, bundles.push_back(bundles.back() + rays)) {
    const float x = draw(0, 10), y = draw(0, 10);
    for (std::size_t ray = 0; ray < rays; ray++) {
      from.insert(from.end(), {x, y, 0});
      to.insert(to.end(), {draw(0, 10), draw(0, 10), 10});
    }
  }
  mrv::segments segments(mrv::span<const float>(from), mrv::span<const float>(to), bundles);
  segments.feature_size = 1;  // shadows of at least 1 m are resolved
  segments.emitter_size = 5;

  std::vector<float> exact(points), averaged(points);
  const auto timed = [&](mrv::engine engine, std::vector<float> &transmittance) {
    mrv::answers wanted;
    wanted.transmittance = transmittance;
    const auto start = std::chrono::steady_clock::now();
    model.visibility(engine, segments, wanted);
    return std::chrono::duration<double, std::milli>(std::chrono::steady_clock::now() - start).count();
  };
  const double exact_time = timed(mrv::engine::exact, exact), mr_time = timed(mrv::engine::multi_resolution, averaged);
  double square = 0;
  for (std::size_t i = 0; i < points; i++) square += std::pow(exact[i] - averaged[i], 2);
  std::printf("exact %.1f ms, multi-resolution %.1f ms, RMS difference %.4f\n", exact_time, mr_time,
              std::sqrt(square / static_cast<double>(points)));
} catch (const mrv::error &error) {
  std::fprintf(stderr, "%s\n", error.what());
  return 1;
}
