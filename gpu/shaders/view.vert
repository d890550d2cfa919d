// gpu/shaders/view.vert — a vertex to a map on which light may be warped; see gpu/view_maps.h.
#version 450

layout(location = 0) in vec3 pMesh;
// Rows of the instance's map to the view's frame.
layout(location = 1) in vec4 rowX;
layout(location = 2) in vec4 rowY;
layout(location = 3) in vec4 rowZ;

layout(push_constant) uniform View {
    mat4 clipFromView;
    vec4 wedge[2];  // half planes: dot(xyz, clip.xyw) + w >= 0
};

out gl_PerVertex {
    vec4 gl_Position;
    float gl_ClipDistance[2];
};

void main() {
    vec3 pView = vec3(rowX.x, rowY.x, rowZ.x) * pMesh.x;
    pView += vec3(rowX.y, rowY.y, rowZ.y) * pMesh.y;
    pView += vec3(rowX.z, rowY.z, rowZ.z) * pMesh.z;
    pView += vec3(rowX.w, rowY.w, rowZ.w);
    vec4 pClip = clipFromView * vec4(pView, 1.0);
    gl_Position = pClip;
    for (int i = 0; i < 2; ++i) gl_ClipDistance[i] = dot(wedge[i].xyz, pClip.xyw) + wedge[i].w;
}
