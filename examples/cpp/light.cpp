// Light over a floor: a lamp above a table, from arrays of this program. Writes the irradiance of the floor as an image.
//   light [IMAGE.ppm]
#include <mrvis.hpp>

#include <algorithm>
#include <cmath>
#include <fstream>
#include <iostream>

// A horizontal rectangle that faces up or down.
static void add(mrv::scene_builder &builder, const char *name, float x, float y, float z, float half, bool up, uint32_t material) {
  const std::array<float, 12> corners{x - half, y - half, z, x + half, y - half, z, x + half, y + half, z, x - half, y + half, z};
  const std::array<uint32_t, 6> above{0, 1, 2, 0, 2, 3}, below{0, 2, 1, 0, 3, 2};
  builder.add_object(mrv::triangles(name, corners, up ? above : below, material));
}

int main(int count, char **arguments) try {
  mrv::scene_builder builder = mrv::scene_builder::create();
  const uint32_t wood = builder.add_material("wood", {.5f, .4f, .3f});
  const uint32_t lamp = builder.add_material("lamp", {0, 0, 0}, {40, 40, 40});  // W/(m^2 sr)
  add(builder, "floor", 0, 0, 0, 2, true, wood);
  add(builder, "table", .4f, 0, .7f, .5f, true, wood);
  add(builder, "lamp", 0, 0, 2.4f, .2f, false, lamp);
  const mrv::model model = mrv::model::prepare(builder.finish());
  const mrv::solution solution = model.solve();

  const std::size_t size = 128;
  std::vector<double> points, normals;
  for (std::size_t i = 0; i < size * size; i++) {
    const auto at = [&](std::size_t pixel) { return 4 * (static_cast<double>(pixel) + .5) / size - 2; };
    points.insert(points.end(), {at(i % size), -at(i / size), 0});
    normals.insert(normals.end(), {0, 0, 1});
  }
  const std::vector<double> irradiance = solution.irradiance(points, normals);  // W/m^2, three channels a point

  const double brightest = *std::max_element(irradiance.begin(), irradiance.end());
  std::ofstream image(count > 1 ? arguments[1] : "light.ppm", std::ios::binary);
  image << "P6\n" << size << " " << size << "\n255\n";
  for (const double channel : irradiance)
    image.put(static_cast<char>(std::lround(255 * std::pow(channel / brightest, 1 / 2.2))));
  std::cout << "brightest " << brightest << " W/m^2, mean of all surfaces " << solution.info().mean_irradiance[1] << " W/m^2\n";
  return image.flush() ? 0 : 1;
} catch (const mrv::error &error) {
  std::cerr << error.what() << "\n";
  return 1;
}
