// gpu/shaders/spot.vert — a vertex to the clip space of a spot light; see cache/spot_cache.h.
#version 450

layout(location = 0) in vec3 pMesh;
// Rows of the instance's map to the light's frame, in units in which its near plane is z = 1 and the
// edges of its map are |x|, |y| = z.
layout(location = 1) in vec4 rowX;
layout(location = 2) in vec4 rowY;
layout(location = 3) in vec4 rowZ;

void main() {
    vec3 pLight = vec3(rowX.x, rowY.x, rowZ.x) * pMesh.x;
    pLight += vec3(rowX.y, rowY.y, rowZ.y) * pMesh.y;
    pLight += vec3(rowX.z, rowY.z, rowZ.z) * pMesh.z;
    pLight += vec3(rowX.w, rowY.w, rowZ.w);
    gl_Position = vec4(pLight.xy, pLight.z - 1.0, pLight.z);  // depth 1 - 1 / z
}
