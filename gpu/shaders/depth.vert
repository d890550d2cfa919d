// gpu/shaders/depth.vert — a vertex to clip space; the depth pass has no other shader.
// The layouts match cache::FramePlan::transforms and what gpu/draw_list.h writes.
#version 450

struct Rows {
    vec4 x, y, depth;
};
layout(std430, set = 0, binding = 0) readonly buffer Transforms { Rows clipFromMesh[]; };
layout(std430, set = 0, binding = 1) readonly buffer Instances { uint transformOf[]; };

layout(location = 0) in vec3 pMesh;

void main() {
    // gl_InstanceIndex counts from the draw's firstInstance, so each draw reads its own stretch.
    const Rows m = clipFromMesh[transformOf[gl_InstanceIndex]];
    // Products and sums in this order, each rounded to float: the CPU can compute the same bits.
    precise vec3 pClip = vec3(m.x.x, m.y.x, m.depth.x) * pMesh.x;
    pClip += vec3(m.x.y, m.y.y, m.depth.y) * pMesh.y;
    pClip += vec3(m.x.z, m.y.z, m.depth.z) * pMesh.z;
    pClip += vec3(m.x.w, m.y.w, m.depth.w);
    gl_Position = vec4(pClip, 1.0);
}
