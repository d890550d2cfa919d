// gpu/shaders/move.comp — adds a step to the depths in a buffer; see MapMove in gpu/view_maps.h.
// Source: Day, "CSM Scrolling", 2012: the last of its shaders, but for the clamp.
#version 450

layout(local_size_x = 64) in;
layout(std430, set = 0, binding = 0) buffer Depths { uint words[]; };
layout(push_constant) uniform Move {
    uint wordCount;
    uint halves;  // 1: a word is two units of 16 bits; 0: one float
    int units;
    float offset, nearest;  // the same for floats
};

uint movedUnit(uint old) { return old == 65535u ? old : uint(clamp(int(old) + units, 1, 65535)); }
float movedFloat(float old) { return old == 1.0 ? old : clamp(old + offset, nearest, 1.0); }

void main() {
    const uint threads = gl_NumWorkGroups.x * gl_WorkGroupSize.x;
    for (uint i = gl_GlobalInvocationID.x; i < wordCount; i += threads)
        words[i] = halves != 0 ? movedUnit(words[i] & 0xffffu) | movedUnit(words[i] >> 16) << 16
                               : floatBitsToUint(movedFloat(uintBitsToFloat(words[i])));
}
