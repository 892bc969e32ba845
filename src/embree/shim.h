/* C interface to Embree: ray packets, and the floating-point mode during queries.
 *
 * No Embree ray struct is visible to Rust: their layout depends on the configuration of the installed library. */
#ifndef MRVIS_EMBREE_SHIM_H
#define MRVIS_EMBREE_SHIM_H
#include <embree4/rtcore.h>
#include <stddef.h>
#include <stdint.h>

/* 16 segments in lanes; mirrors `ray::Packet` field by field (both sides assert size and offsets).
 * The point of lane i at parameter t is origin + t * direction; hits count at near <= t <= far. */
typedef struct {
    _Alignas(64) float origin[3][16];
    float direction[3][16];
    float near_t[16];
    float far_t[16];
    uint32_t active; /* bit i: lane i is a segment */
    uint32_t backwards; /* this and the next are of no use to Embree */
    float slack[2][2];
} mrvis_packet;

/* RTC_VERSION of the headers that the shim was compiled with. */
int mrvis_headers_version(void);

/* Traces `count` packets for any hit. Bit i of occluded[k] is set if lane i of packets[k] is active and blocked.
 * `width` is 1, 4, 8 or 16 rays per call; `coherent` selects Embree's traversal for coherent rays. Flush-to-zero
 * and denormals-are-zero are set during the call, as Embree recommends, and restored: Rust code must not change the
 * floating-point mode. */
void mrvis_occluded(RTCScene scene, const mrvis_packet *packets, size_t count, int width, int coherent,
                    uint32_t *occluded);

/* First hits of 16 segments: triangle index within the first geometry (0xffffffff without a hit) and parameter t. */
typedef struct {
    uint32_t triangle[16];
    uint32_t instance[16]; /* index in a scene of instances, 0 in other scenes; undefined without a hit */
    float t[16];
} mrvis_hits;

/* Traces `count` packets for their first hits. Arguments as in mrvis_occluded. At a hit of a piece of a grid the highest bit of the triangle is set,
 * the others are the number of the piece. If `places` is not null, it gets the coordinates u and v of the hits: 32 numbers for each packet. */
void mrvis_first_hits(RTCScene scene, const mrvis_packet *packets, size_t count, int width, int coherent,
                      mrvis_hits *hits, float *places);
#endif
