#include "shim.h"
#include <string.h>
#if defined(__SSE2__)
#include <emmintrin.h>
#endif

_Static_assert(RTC_VERSION_MAJOR == 4, "mrvis needs Embree 4 headers");
_Static_assert(RTC_VERSION >= 40300, "mrvis needs Embree 4.3 headers or newer");

/* Rust does not read Embree's headers: it has what is stated here in src/embree/sys.rs. A unit test compares the names and values. */
#define UNKNOWN " differs between the installed headers of Embree and src/embree/sys.rs: mrvis does not know this version of Embree"
#define CONSTANT(name, value) _Static_assert(name == (value), #name UNKNOWN)
#define FUNCTION(name, result, ...)                                                                         \
    _Static_assert(_Generic(&name, result(*)(__VA_ARGS__) : 1, default : 0), #name UNKNOWN)

CONSTANT(RTC_ERROR_OUT_OF_MEMORY, 4);
CONSTANT(RTC_ERROR_UNSUPPORTED_CPU, 5);
CONSTANT(RTC_ERROR_CANCELLED, 6);
CONSTANT(RTC_DEVICE_PROPERTY_VERSION, 0);
CONSTANT(RTC_DEVICE_PROPERTY_NATIVE_RAY4_SUPPORTED, 32);
CONSTANT(RTC_DEVICE_PROPERTY_NATIVE_RAY8_SUPPORTED, 33);
CONSTANT(RTC_DEVICE_PROPERTY_NATIVE_RAY16_SUPPORTED, 34);
CONSTANT(RTC_SCENE_FLAG_ROBUST, 4);
CONSTANT(RTC_GEOMETRY_TYPE_TRIANGLE, 0);
CONSTANT(RTC_GEOMETRY_TYPE_GRID, 2);
CONSTANT(RTC_GEOMETRY_TYPE_INSTANCE, 121);
CONSTANT(RTC_BUFFER_TYPE_INDEX, 0);
CONSTANT(RTC_BUFFER_TYPE_VERTEX, 1);
CONSTANT(RTC_BUFFER_TYPE_GRID, 8);
CONSTANT(RTC_FORMAT_UINT3, 0x5003);
CONSTANT(RTC_FORMAT_FLOAT3, 0x9003);
CONSTANT(RTC_FORMAT_FLOAT3X4_COLUMN_MAJOR, 0x9234);
CONSTANT(RTC_FORMAT_GRID, 0xA001);

/* `unsigned` is what compilers take for Embree's enumerations, and what Rust passes. */
FUNCTION(rtcNewDevice, RTCDevice, const char *);
FUNCTION(rtcReleaseDevice, void, RTCDevice);
FUNCTION(rtcGetDeviceError, unsigned, RTCDevice);
FUNCTION(rtcGetDeviceProperty, ssize_t, RTCDevice, unsigned);
FUNCTION(rtcSetDeviceErrorFunction, void, RTCDevice, void (*)(void *, unsigned, const char *), void *);
FUNCTION(rtcSetDeviceMemoryMonitorFunction, void, RTCDevice, bool (*)(void *, ssize_t, bool), void *);
FUNCTION(rtcNewScene, RTCScene, RTCDevice);
FUNCTION(rtcReleaseScene, void, RTCScene);
FUNCTION(rtcSetSceneFlags, void, RTCScene, unsigned);
FUNCTION(rtcSetSceneProgressMonitorFunction, void, RTCScene, bool (*)(void *, double), void *);
FUNCTION(rtcCommitScene, void, RTCScene);
FUNCTION(rtcAttachGeometryByID, void, RTCScene, RTCGeometry, unsigned);
FUNCTION(rtcNewGeometry, RTCGeometry, RTCDevice, unsigned);
FUNCTION(rtcReleaseGeometry, void, RTCGeometry);
FUNCTION(rtcCommitGeometry, void, RTCGeometry);
FUNCTION(rtcSetNewGeometryBuffer, void *, RTCGeometry, unsigned, unsigned, unsigned, size_t, size_t);
FUNCTION(rtcSetGeometryInstancedScene, void, RTCGeometry, RTCScene);
FUNCTION(rtcSetGeometryTransform, void, RTCGeometry, unsigned, unsigned, const void *);

_Static_assert(sizeof(ssize_t) == sizeof(void *) && sizeof(size_t) == sizeof(void *) && sizeof(unsigned) == 4,
               "types of C that are not those of Rust");
_Static_assert(RTC_INVALID_GEOMETRY_ID == 0xffffffff, "RTC_INVALID_GEOMETRY_ID" UNKNOWN); /* Hits::NOTHING */
_Static_assert(sizeof(struct RTCRay) == 48, "RTCRay layout");
_Static_assert(sizeof(struct RTCRay16) == 12 * 64, "RTCRay16 layout");
_Static_assert(offsetof(struct RTCRay16, tfar) == 8 * 64, "RTCRay16 layout");

_Static_assert(sizeof(struct RTCGrid) == 12 && offsetof(struct RTCGrid, stride) == 4 && offsetof(struct RTCGrid, width) == 8,
               "RTCGrid layout");

/* The same numbers as in src/embree/sys.rs. */
_Static_assert(sizeof(mrvis_packet) == 576 && _Alignof(mrvis_packet) == 64, "mrvis_packet layout");
_Static_assert(offsetof(mrvis_packet, origin) == 0, "mrvis_packet layout");
_Static_assert(offsetof(mrvis_packet, direction) == 192, "mrvis_packet layout");
_Static_assert(offsetof(mrvis_packet, near_t) == 384, "mrvis_packet layout");
_Static_assert(offsetof(mrvis_packet, far_t) == 448, "mrvis_packet layout");
_Static_assert(offsetof(mrvis_packet, active) == 512, "mrvis_packet layout");
_Static_assert(sizeof(mrvis_hits) == 192 && _Alignof(mrvis_hits) == 4, "mrvis_hits layout");
_Static_assert(offsetof(mrvis_hits, triangle) == 0, "mrvis_hits layout");
_Static_assert(offsetof(mrvis_hits, instance) == 64, "mrvis_hits layout");
_Static_assert(offsetof(mrvis_hits, t) == 128, "mrvis_hits layout");

int mrvis_headers_version(void) { return RTC_VERSION; }

/* The mask of rays that meet all geometries. */
#define ALL_GEOMETRIES 0xffffffffu

/* Traces lanes [first, first + W) of a packet as Embree packets and adds the blocked lanes to `result`. */
#define TRACE_WIDE(W, ALIGN)                                                                                \
    for (int first = 0; first < 16; first += W) {                                                           \
        const uint32_t lanes = (p->active >> first) & (uint32_t)((1ull << W) - 1);                          \
        if (!lanes) continue;                                                                               \
        _Alignas(ALIGN) struct RTCRay##W ray;                                                               \
        _Alignas(ALIGN) int valid[W];                                                                       \
        const size_t bytes = W * sizeof(float);                                                             \
        memcpy(ray.org_x, p->origin[0] + first, bytes);                                                     \
        memcpy(ray.org_y, p->origin[1] + first, bytes);                                                     \
        memcpy(ray.org_z, p->origin[2] + first, bytes);                                                     \
        memcpy(ray.dir_x, p->direction[0] + first, bytes);                                                  \
        memcpy(ray.dir_y, p->direction[1] + first, bytes);                                                  \
        memcpy(ray.dir_z, p->direction[2] + first, bytes);                                                  \
        memcpy(ray.tnear, p->near_t + first, bytes);                                                        \
        memcpy(ray.tfar, p->far_t + first, bytes);                                                          \
        for (int i = 0; i < W; i++) {                                                                       \
            valid[i] = (lanes >> i) & 1 ? -1 : 0;                                                           \
            ray.time[i] = 0.0f;                                                                             \
            ray.mask[i] = ALL_GEOMETRIES;                                                                   \
            ray.id[i] = 0;                                                                                  \
            ray.flags[i] = 0;                                                                               \
        }                                                                                                   \
        rtcOccluded##W(valid, scene, &ray, &args);                                                          \
        for (int i = 0; i < W; i++) result |= (uint32_t)(valid[i] && ray.tfar[i] < 0.0f) << (first + i);    \
    }

static uint32_t trace_single(RTCScene scene, const mrvis_packet *p, struct RTCOccludedArguments *args) {
    uint32_t result = 0;
    for (uint32_t left = p->active; left; left &= left - 1) {
        const int i = __builtin_ctz(left);
        struct RTCRay ray;
        memset(&ray, 0, sizeof ray);
        /* Compilers merge these copies into two 16-byte stores; scalar stores would stall Embree's wide loads. */
        const float head[4] = {p->origin[0][i], p->origin[1][i], p->origin[2][i], p->near_t[i]};
        const float tail[4] = {p->direction[0][i], p->direction[1][i], p->direction[2][i], 0.0f};
        memcpy(&ray.org_x, head, sizeof head);
        memcpy(&ray.dir_x, tail, sizeof tail);
        ray.tfar = p->far_t[i];
        ray.mask = ALL_GEOMETRIES;
        rtcOccluded1(scene, &ray, args);
        result |= (uint32_t)(ray.tfar < 0.0f) << i;
    }
    return result;
}

void mrvis_occluded(RTCScene scene, const mrvis_packet *packets, size_t count, int width, int coherent,
                    uint32_t *occluded) {
#if defined(__SSE2__)
    const unsigned int csr = _mm_getcsr();
    _mm_setcsr(csr | 0x8040u); /* FTZ | DAZ */
#endif
    struct RTCOccludedArguments args;
    rtcInitOccludedArguments(&args);
    args.flags = coherent ? RTC_RAY_QUERY_FLAG_COHERENT : RTC_RAY_QUERY_FLAG_INCOHERENT;
    for (size_t k = 0; k < count; k++) {
        const mrvis_packet *p = packets + k;
        uint32_t result = 0;
        switch (width) {
        case 16: TRACE_WIDE(16, 64) break;
        case 8: TRACE_WIDE(8, 32) break;
        case 4: TRACE_WIDE(4, 16) break;
        default: result = trace_single(scene, p, &args); break;
        }
        occluded[k] = result;
    }
#if defined(__SSE2__)
    _mm_setcsr(csr);
#endif
}

/* Traces lanes [first, first + W) of a packet for first hits and writes them to hits[k]. */
/* Scenes without instances count as the first instance. */
static inline uint32_t instance_of(unsigned int id) { return id == RTC_INVALID_GEOMETRY_ID ? 0 : id; }

/* The triangles of a scene are its first geometry; those of grids are told apart by the highest bit. */
static inline uint32_t triangle_of(unsigned int geometry, unsigned int primitive) {
    return geometry == 0 || geometry == RTC_INVALID_GEOMETRY_ID ? primitive : primitive | 0x80000000u;
}

#define HIT_WIDE(W, ALIGN)                                                                                  \
    for (int first = 0; first < 16; first += W) {                                                           \
        const uint32_t lanes = (p->active >> first) & (uint32_t)((1ull << W) - 1);                          \
        if (!lanes) continue;                                                                               \
        _Alignas(ALIGN) struct RTCRayHit##W query;                                                          \
        _Alignas(ALIGN) int valid[W];                                                                       \
        const size_t bytes = W * sizeof(float);                                                             \
        memcpy(query.ray.org_x, p->origin[0] + first, bytes);                                               \
        memcpy(query.ray.org_y, p->origin[1] + first, bytes);                                               \
        memcpy(query.ray.org_z, p->origin[2] + first, bytes);                                               \
        memcpy(query.ray.dir_x, p->direction[0] + first, bytes);                                            \
        memcpy(query.ray.dir_y, p->direction[1] + first, bytes);                                            \
        memcpy(query.ray.dir_z, p->direction[2] + first, bytes);                                            \
        memcpy(query.ray.tnear, p->near_t + first, bytes);                                                  \
        memcpy(query.ray.tfar, p->far_t + first, bytes);                                                    \
        for (int i = 0; i < W; i++) {                                                                       \
            valid[i] = (lanes >> i) & 1 ? -1 : 0;                                                           \
            query.ray.time[i] = 0.0f;                                                                       \
            query.ray.mask[i] = ALL_GEOMETRIES;                                                             \
            query.ray.id[i] = 0;                                                                            \
            query.ray.flags[i] = 0;                                                                         \
            query.hit.geomID[i] = RTC_INVALID_GEOMETRY_ID;                                                  \
            query.hit.primID[i] = RTC_INVALID_GEOMETRY_ID;                                                  \
            query.hit.instID[0][i] = RTC_INVALID_GEOMETRY_ID;                                               \
        }                                                                                                   \
        rtcIntersect##W(valid, scene, &query, &args);                                                       \
        for (int i = 0; i < W; i++) {                                                                       \
            const uint32_t hit = triangle_of(query.hit.geomID[i], query.hit.primID[i]);                     \
            hits[k].triangle[first + i] = valid[i] ? hit : RTC_INVALID_GEOMETRY_ID;                         \
            hits[k].instance[first + i] = instance_of(query.hit.instID[0][i]);                              \
            hits[k].t[first + i] = query.ray.tfar[i];                                                       \
            if (places) places[32 * k + first + i] = query.hit.u[i];                                        \
            if (places) places[32 * k + 16 + first + i] = query.hit.v[i];                                   \
        }                                                                                                   \
    }

static void hit_single(RTCScene scene, const mrvis_packet *p, struct RTCIntersectArguments *args,
                       mrvis_hits *hits, float *places) {
    for (uint32_t left = p->active; left; left &= left - 1) {
        const int i = __builtin_ctz(left);
        struct RTCRayHit query;
        memset(&query, 0, sizeof query);
        const float head[4] = {p->origin[0][i], p->origin[1][i], p->origin[2][i], p->near_t[i]};
        const float tail[4] = {p->direction[0][i], p->direction[1][i], p->direction[2][i], 0.0f};
        memcpy(&query.ray.org_x, head, sizeof head);
        memcpy(&query.ray.dir_x, tail, sizeof tail);
        query.ray.tfar = p->far_t[i];
        query.ray.mask = ALL_GEOMETRIES;
        query.hit.geomID = RTC_INVALID_GEOMETRY_ID;
        query.hit.primID = RTC_INVALID_GEOMETRY_ID;
        query.hit.instID[0] = RTC_INVALID_GEOMETRY_ID;
        rtcIntersect1(scene, &query, args);
        hits->triangle[i] = triangle_of(query.hit.geomID, query.hit.primID);
        hits->instance[i] = instance_of(query.hit.instID[0]);
        hits->t[i] = query.ray.tfar;
        if (places) places[i] = query.hit.u;
        if (places) places[16 + i] = query.hit.v;
    }
}

void mrvis_first_hits(RTCScene scene, const mrvis_packet *packets, size_t count, int width, int coherent,
                      mrvis_hits *hits, float *places) {
#if defined(__SSE2__)
    const unsigned int csr = _mm_getcsr();
    _mm_setcsr(csr | 0x8040u); /* FTZ | DAZ */
#endif
    struct RTCIntersectArguments args;
    rtcInitIntersectArguments(&args);
    args.flags = coherent ? RTC_RAY_QUERY_FLAG_COHERENT : RTC_RAY_QUERY_FLAG_INCOHERENT;
    for (size_t k = 0; k < count; k++) {
        const mrvis_packet *p = packets + k;
        for (int i = 0; i < 16; i++) hits[k].triangle[i] = RTC_INVALID_GEOMETRY_ID;
        switch (width) {
        case 16: HIT_WIDE(16, 64) break;
        case 8: HIT_WIDE(8, 32) break;
        case 4: HIT_WIDE(4, 16) break;
        default: hit_single(scene, p, &args, hits + k, places ? places + 32 * k : places); break;
        }
    }
#if defined(__SSE2__)
    _mm_setcsr(csr);
#endif
}
