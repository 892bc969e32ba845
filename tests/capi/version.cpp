// Everything that needs no handle yet refuses a library of another version, in words that a user can compare.
#include "mrvis.h"

static int32_t version_of_another_library() { return 10203; }
#define mrv_version version_of_another_library
#include "mrvis.hpp"

#include <cstdio>
#include <cstdlib>

template <class Call>
static void is_refused(const char *name, Call call) {
  try {
    call();
  } catch (const mrv::error &error) {
    const std::string text = error.what();
    if (error.status() == mrv::status::unsupported && text.find("version 1.2.3,") != std::string::npos &&
        text.find("compiled for 0.1.0:") != std::string::npos)
      return;
    std::fprintf(stderr, "%s: %s\n", name, error.what());
    std::exit(1);
  }
  std::fprintf(stderr, "%s is not refused\n", name);
  std::exit(1);
}

int main() {
  const mrv::fbem_images images;
  is_refused("scene::load", [] { mrv::scene::load("none.obj"); });
  is_refused("scene::generate", [] { mrv::scene::generate("cornell"); });
  is_refused("scene_builder", [] { mrv::scene_builder::create(); });
  is_refused("embree_version", [] { mrv::embree_version(); });
  is_refused("fbem", [&] { mrv::fbem(images, {}); });
  is_refused("fbem_with_masked", [&] { mrv::fbem_with_masked(images, {}); });
}
