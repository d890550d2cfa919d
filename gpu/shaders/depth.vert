// gpu/shaders/depth.vert — a vertex to clip space; the depth pass has no other shader.
#version 450

layout(location = 0) in vec3 pMesh;
// Rows of the instance's map to clip space. As attributes a software driver reads them once per draw;
// from a storage buffer it would gather them for every vertex.
layout(location = 1) in vec4 rowX;
layout(location = 2) in vec4 rowY;
layout(location = 3) in vec4 rowDepth;

void main() {
    // Products and sums in this order, each rounded to float: the CPU can compute the same bits.
    precise vec3 pClip = vec3(rowX.x, rowY.x, rowDepth.x) * pMesh.x;
    pClip += vec3(rowX.y, rowY.y, rowDepth.y) * pMesh.y;
    pClip += vec3(rowX.z, rowY.z, rowDepth.z) * pMesh.z;
    pClip += vec3(rowX.w, rowY.w, rowDepth.w);
    gl_Position = vec4(pClip, 1.0);
}
