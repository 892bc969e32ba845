/* The part of Embree that stays in C: ray packets and the floating-point mode around them.
 *
 * No Embree ray struct crosses into Rust: their layout depends on how the installed library was configured. */
#ifndef MRVIS_EMBREE_SHIM_H
#define MRVIS_EMBREE_SHIM_H
#include <embree4/rtcore.h>
#include <stddef.h>
#include <stdint.h>

/* 16 segments in lanes; mirrors `ray::Packet` field by field (the Rust side asserts size and offsets).
 * The point at parameter t of lane i is origin + t * direction; hits count for near <= t <= far. */
typedef struct {
    _Alignas(64) float origin[3][16];
    float direction[3][16];
    float near_t[16];
    float far_t[16];
    uint32_t active; /* bit i: lane i is a segment */
} mrvis_packet;

/* Traces `count` packets for any hit. Bit i of occluded[k] is set if lane i of packets[k] is active and
 * blocked. `width` is 1, 4, 8 or 16 rays a call; `coherent` asks for the packet traversal meant for rays that
 * stay together; `mask` selects geometries. Flush-to-zero and denormals-are-zero are on inside, as Embree
 * recommends, and restored: Rust code may not change them itself. */
void mrvis_occluded(RTCScene scene, const mrvis_packet *packets, size_t count, int width, int coherent,
                    uint32_t mask, uint32_t *occluded);

/* The first hit of 16 segments: the triangle's number within its geometry (0xffffffff where nothing is hit) and
 * the parameter t of the hit. */
typedef struct {
    uint32_t triangle[16];
    float t[16];
} mrvis_hits;

/* Traces `count` packets for their first hits; the arguments are those of mrvis_occluded. */
void mrvis_first_hits(RTCScene scene, const mrvis_packet *packets, size_t count, int width, int coherent,
                      uint32_t mask, mrvis_hits *hits);
#endif
