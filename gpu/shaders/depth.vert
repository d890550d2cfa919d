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
    const vec4 v = vec4(pMesh, 1.0);
    gl_Position = vec4(dot(m.x, v), dot(m.y, v), dot(m.depth, v), 1.0);
}
