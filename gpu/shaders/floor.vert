// gpu/shaders/floor.vert — passes a position on that is in clip space already.
#version 450

layout(location = 0) in vec3 pClip;

void main() { gl_Position = vec4(pClip, 1.0); }
