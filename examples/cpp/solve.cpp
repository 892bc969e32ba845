// A full solution with a progress bar; ends early after a number of seconds and keeps what was reached.
//   solve [SCENE [SECONDS]]
#include <mrvis.hpp>

#include <chrono>
#include <cstdlib>
#include <iostream>

int main(int count, char **arguments) try {
  const double seconds = count > 2 ? std::atof(arguments[2]) : 1e9;
  const mrv::scene scene = count > 1 ? mrv::scene::load(arguments[1]) : mrv::scene::generate("desk-room");
  const mrv::scene_info info = scene.info();
  std::cout << info.triangles << " triangles, " << info.emitters << " emitters\n";

  const auto start = std::chrono::steady_clock::now();
  const auto bar = [&](const char *stage, double done) {
    const auto filled = static_cast<std::size_t>(30 * (done < 0 ? 0 : done));
    std::cerr << "\r" << std::string(filled, '#') << std::string(30 - filled, '.') << " " << stage << "\033[K";
    return std::chrono::duration<double>(std::chrono::steady_clock::now() - start).count() < seconds;
  };
  const mrv::model model = mrv::model::prepare(scene);
  const mrv::solution solution = model.solve({}, bar);
  std::cerr << "\n";

  const mrv::solution_info found = solution.info();
  std::cout << (found.interrupted ? "cancelled; so far: " : "done: ") << "mean irradiance " << found.mean_irradiance[1] << " W/m^2";
  if (found.error_estimate >= 0) std::cout << ", error about " << 100 * found.error_estimate << " %";
  std::cout << "\n";
} catch (const mrv::error &error) {
  std::cerr << error.what() << "\n";
  return 1;
}
