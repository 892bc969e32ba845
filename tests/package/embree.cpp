// A host with an Embree device and a TBB of its own: both work while the library computes, and the library's answers stay the same.
#include <embree4/rtcore.h>
#include <tbb/parallel_for.h>
#include <tbb/task_arena.h>

#include <atomic>
#include <thread>
#include <vector>

#include "check.h"

// Rays of the host against a triangle of the host that hit it.
static int hits(RTCScene scene) {
  std::atomic<int> found{0};
  tbb::parallel_for(0, 10000, [&](int i) {
    RTCRay ray{};
    ray.org_x = static_cast<float>(i % 100) / 100;
    ray.org_y = static_cast<float>(i) / 10000;
    ray.org_z = 1;
    ray.dir_z = -1;
    ray.tfar = 10;
    ray.mask = 0xffffffff;
    rtcOccluded1(scene, &ray);
    if (ray.tfar < 0) found++;
  });
  return found;
}

static RTCScene triangle(RTCDevice device) {
  RTCGeometry geometry = rtcNewGeometry(device, RTC_GEOMETRY_TYPE_TRIANGLE);
  auto *vertices = static_cast<float *>(rtcSetNewGeometryBuffer(geometry, RTC_BUFFER_TYPE_VERTEX, 0, RTC_FORMAT_FLOAT3, 12, 3));
  auto *indices = static_cast<unsigned *>(rtcSetNewGeometryBuffer(geometry, RTC_BUFFER_TYPE_INDEX, 0, RTC_FORMAT_UINT3, 12, 1));
  const float corners[9] = {0, 0, 0, 1, 0, 0, 0, 1, 0};
  for (int i = 0; i < 9; i++) vertices[i] = corners[i];
  for (unsigned i = 0; i < 3; i++) indices[i] = i;
  rtcCommitGeometry(geometry);
  RTCScene scene = rtcNewScene(device);
  rtcAttachGeometry(scene, geometry);
  rtcReleaseGeometry(geometry);
  rtcCommitScene(scene);
  return scene;
}

int main() {
  RTCDevice device = rtcNewDevice(nullptr);
  CHECK(device != nullptr);
  RTCScene scene = triangle(device);
  const int alone = hits(scene);
  CHECK(alone > 4500 && alone < 5500);

  mrv_model *model = prepared(2);
  const double expected = seen(model, MRV_ENGINE_MULTI_RESOLUTION, 0.1f) + light(model);
  std::atomic<bool> done{false};
  std::thread host([&] {
    while (!done) {
      CHECK(hits(scene) == alone);
      RTCScene other = triangle(device);
      rtcReleaseScene(other);
    }
  });
  // Also from inside an arena of the host.
  tbb::task_arena arena(2);
  arena.execute([&] {
    mrv_model *again = prepared(2);
    CHECK(seen(again, MRV_ENGINE_MULTI_RESOLUTION, 0.1f) + light(again) == expected);
    mrv_model_release(again);
  });
  done = true;
  host.join();
  mrv_model_release(model);
  CHECK(hits(scene) == alone && rtcGetDeviceError(device) == RTC_ERROR_NONE);
  rtcReleaseScene(scene);
  rtcReleaseDevice(device);
  std::puts("done");
}
