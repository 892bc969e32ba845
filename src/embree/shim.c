#include "shim.h"
#include <string.h>
#if defined(__SSE2__)
#include <emmintrin.h>
#endif

_Static_assert(RTC_VERSION_MAJOR == 4, "mrvis needs Embree 4 headers");
_Static_assert(RTC_VERSION >= 40300, "mrvis needs Embree 4.3 headers or newer");
_Static_assert(sizeof(struct RTCRay) == 48, "RTCRay layout");
_Static_assert(sizeof(struct RTCRay16) == 12 * 64, "RTCRay16 layout");
_Static_assert(offsetof(struct RTCRay16, tfar) == 8 * 64, "RTCRay16 layout");
_Static_assert(offsetof(mrvis_packet, active) == 8 * 64, "mrvis_packet layout");

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
            ray.mask[i] = mask;                                                                             \
            ray.id[i] = 0;                                                                                  \
            ray.flags[i] = 0;                                                                               \
        }                                                                                                   \
        rtcOccluded##W(valid, scene, &ray, &args);                                                          \
        for (int i = 0; i < W; i++) result |= (uint32_t)(valid[i] && ray.tfar[i] < 0.0f) << (first + i);    \
    }

static uint32_t trace_single(RTCScene scene, const mrvis_packet *p, uint32_t mask,
                             struct RTCOccludedArguments *args) {
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
        ray.mask = mask;
        rtcOccluded1(scene, &ray, args);
        result |= (uint32_t)(ray.tfar < 0.0f) << i;
    }
    return result;
}

void mrvis_occluded(RTCScene scene, const mrvis_packet *packets, size_t count, int width, int coherent,
                    uint32_t mask, uint32_t *occluded) {
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
        default: result = trace_single(scene, p, mask, &args); break;
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
            query.ray.mask[i] = mask;                                                                       \
            query.ray.id[i] = 0;                                                                            \
            query.ray.flags[i] = 0;                                                                         \
            query.hit.geomID[i] = RTC_INVALID_GEOMETRY_ID;                                                  \
            query.hit.primID[i] = RTC_INVALID_GEOMETRY_ID;                                                  \
            query.hit.instID[0][i] = RTC_INVALID_GEOMETRY_ID;                                               \
        }                                                                                                   \
        rtcIntersect##W(valid, scene, &query, &args);                                                       \
        for (int i = 0; i < W; i++) {                                                                       \
            hits[k].triangle[first + i] = valid[i] ? query.hit.primID[i] : RTC_INVALID_GEOMETRY_ID;         \
            hits[k].instance[first + i] = instance_of(query.hit.instID[0][i]);                              \
            hits[k].t[first + i] = query.ray.tfar[i];                                                       \
        }                                                                                                   \
    }

static void hit_single(RTCScene scene, const mrvis_packet *p, uint32_t mask, struct RTCIntersectArguments *args,
                       mrvis_hits *hits) {
    for (uint32_t left = p->active; left; left &= left - 1) {
        const int i = __builtin_ctz(left);
        struct RTCRayHit query;
        memset(&query, 0, sizeof query);
        const float head[4] = {p->origin[0][i], p->origin[1][i], p->origin[2][i], p->near_t[i]};
        const float tail[4] = {p->direction[0][i], p->direction[1][i], p->direction[2][i], 0.0f};
        memcpy(&query.ray.org_x, head, sizeof head);
        memcpy(&query.ray.dir_x, tail, sizeof tail);
        query.ray.tfar = p->far_t[i];
        query.ray.mask = mask;
        query.hit.geomID = RTC_INVALID_GEOMETRY_ID;
        query.hit.primID = RTC_INVALID_GEOMETRY_ID;
        query.hit.instID[0] = RTC_INVALID_GEOMETRY_ID;
        rtcIntersect1(scene, &query, args);
        hits->triangle[i] = query.hit.primID;
        hits->instance[i] = instance_of(query.hit.instID[0]);
        hits->t[i] = query.ray.tfar;
    }
}

void mrvis_first_hits(RTCScene scene, const mrvis_packet *packets, size_t count, int width, int coherent,
                      uint32_t mask, mrvis_hits *hits) {
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
        default: hit_single(scene, p, mask, &args, hits + k); break;
        }
    }
#if defined(__SSE2__)
    _mm_setcsr(csr);
#endif
}
