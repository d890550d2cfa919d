// gpu/shaders/shadow_pass.comp — light at points of the view; see gpu/shadow_pass.h. Points, planes and rectangles are
// relative to the eye, along the axes of light space [m], but where they are said to be the world's.
#version 450
#extension GL_EXT_samplerless_texture_functions : require

layout(local_size_x = 64) in;
layout(constant_id = 0) const int kTaps = 1;
layout(constant_id = 1) const bool kTurned = false;
layout(constant_id = 2) const bool kBetween = false;

struct View {
    mat4 clipFromEye, eyeFromClip;
    vec4 wedge[2];
    vec4 rect;  // low, high
    vec2 interval;
};
struct Map {
    ivec3 corner;  // of its first texel: x, y, layer
    int first, end;  // of its views
};
struct Receiver {
    vec3 pWorld;  // from the eye
    uint pixel;
    vec3 normalWorld;
    float unused;
};
struct Answer {
    float light;
    int view;
};

layout(std140, set = 0, binding = 0) uniform Scene {
    View views[8];
    Map maps[8];
    mat3 lightFromWorld;
    vec4 steps[9];
    vec3 forward;  // world
    int mapCount;
    vec4 bias;  // receiver, gradient, its most, normal offset
    float blend, fade, far, reach;
    int side;
    bool byInterval;
    float mostFall;
} s;
layout(set = 0, binding = 1) uniform texture2DArray depths;
layout(std430, set = 0, binding = 2) readonly buffer Receivers { Receiver receivers[]; };
layout(std430, set = 0, binding = 3) writeonly buffer Answers { Answer answers[]; };
layout(push_constant) uniform Push { uint count; };

// As maps store them; see cache/frame_plan.h.
const float kUnknownDepth = 0.0, kNearestDepth = 1.0 / 65535.0, kEmptyDepth = 1.0;

struct Sample {
    bool known;
    float light;
    int view;
    float outward;  // from 0 in the map's middle to 1 where it ends, filter and all
};
const Sample kNoSample = Sample(false, 1.0, -1, 0.0);

vec4 clipOf(int view, vec3 p) { return s.views[view].clipFromEye * vec4(p, 1.0); }

float insideWedge(int view, vec3 xyw) {
    return min(dot(s.views[view].wedge[0].xyz, xyw), dot(s.views[view].wedge[1].xyz, xyw));
}

/// The view of a map in whose wedge a point lies deepest.
int viewOver(Map map, vec3 p) {
    int best = map.first;
    if (map.end - map.first == 1) return best;
    float most = insideWedge(best, clipOf(best, p).xyw);
    for (int v = map.first + 1; v < map.end; ++v) {
        const float inside = insideWedge(v, clipOf(v, p).xyw);
        if (inside > most) {
            best = v;
            most = inside;
        }
    }
    return best;
}

/// The same for a place of the map.
int ownerOf(Map map, vec2 centre) {
    int best = map.first;
    if (map.end - map.first == 1) return best;
    float most = insideWedge(best, vec3(centre, 1.0));
    for (int v = map.first + 1; v < map.end; ++v) {
        const float inside = insideWedge(v, vec3(centre, 1.0));
        if (inside > most) {
            best = v;
            most = inside;
        }
    }
    return best;
}

/// Edges of the texel over `p`, along x and y of the map: columns.
mat2 texelEdges(int view, vec3 p) {
    const mat4 m = s.views[view].clipFromEye;
    const vec4 clip = clipOf(view, p);
    const vec2 at = clip.xy / clip.w;
    return inverse(mat2((m[0].xy - at * m[0].w) / clip.w, (m[1].xy - at * m[1].w) / clip.w)) * (2.0 / s.side);
}

/// How far toward the sun a point is moved before it is compared [m].
float biasOf(mat2 edges, float texel, vec3 normal) {
    const vec2 rises = abs(normal.xy * edges);
    const float most = s.bias.z * texel, asked = s.bias.y * (rises.x + rises.y), run = abs(normal.z);
    return s.bias.x * texel + (s.bias.y <= 0.0 ? 0.0 : asked < most * run ? asked / run : most);
}

/// Cosine and sine of an angle as good as random for each pixel.
vec2 turnOf(uint pixel) {
    uint bits = (pixel ^ pixel >> 16) * 0x9e3779b1u;
    bits = (bits ^ bits >> 15) * 0x85ebca6bu;
    const float angle = float(int(bits ^ bits >> 13)) * (3.14159265358979 / 2147483648.0);  // in [-pi, pi)
    return vec2(cos(angle), sin(angle));
}

/// The texel of tap `i` for a point at `at`, and its weight.
ivec2 texelOf(int i, vec2 at, vec2 turn) {
    const vec2 step = s.steps[i].xy;
    if (kBetween) return ivec2(floor(at - 0.5) + step);
    return ivec2(floor(at + (kTurned ? vec2(turn.x * step.x - turn.y * step.y, turn.y * step.x + turn.x * step.y) : step)));
}
float weightOf(int i, vec2 at) {
    if (!kBetween) return 1.0 / kTaps;
    const vec2 share = fract(at - 0.5), weights = mix(1.0 - share, share, s.steps[i].xy);
    return weights.x * weights.y;
}

/// How much deeper a point's own plane is at so far from it across the light [m].
float fallOf(vec2 away, float most, vec3 normal) {
    const float fall = -dot(normal.xy, away), run = normal.z;
    if (abs(fall) < most * abs(run)) return fall / run;
    return (fall < 0.0) != (run < 0.0) ? -most : most;
}

/// Whether a texel that is drawn shadows a point at `p`, whose plane falls by `most` at most; z is what is compared.
bool shadows(Map map, ivec2 texel, float stored, vec3 p, float most, vec3 normal) {
    if (stored >= kEmptyDepth) return false;
    const vec2 centre = (vec2(texel) + 0.5) * (2.0 / s.side) - 1.0;
    const int owner = ownerOf(map, centre);
    const float drawn = (stored - kNearestDepth) / (1.0 - kNearestDepth);
    const vec4 caster = s.views[owner].eyeFromClip * vec4(centre, drawn, 1.0);
    const vec3 middle = caster.xyz / caster.w;
    return middle.z < p.z + (most > 0.0 ? fallOf(middle.xy - p.xy, most, normal) : 0.0);
}

/// What one map says of a point.
Sample sampleMap(Map map, vec3 p, vec3 normal, uint pixel) {
    int v = viewOver(map, p);
    if (clipOf(v, p).w <= 0.0) return kNoSample;
    const mat2 edges = texelEdges(v, p);
    const float texel = max(length(edges[0]), length(edges[1]));
    if (s.bias.w > 0.0) {
        p += normal * (s.bias.w * texel * length(normal.xy));
        v = viewOver(map, p);
    }
    const vec4 rect = s.views[v].rect;
    if (any(lessThan(p.xy, rect.xy)) || any(greaterThan(p.xy, rect.zw))) return kNoSample;
    const vec4 clip = clipOf(v, p);
    if (clip.w <= 0.0 || clip.z > clip.w) return kNoSample;
    const vec2 at = (clip.xy / clip.w + 1.0) * (s.side / 2.0);
    const float room = s.byInterval ? 0.0 : s.reach;
    if (min(at.x, at.y) < room || max(at.x, at.y) >= s.side - room) return kNoSample;

    const vec3 compared = vec3(p.xy, p.z - biasOf(edges, texel, normal));
    const vec2 turn = kTurned ? turnOf(pixel) : vec2(1.0, 0.0);
    float lit = 0.0;
    for (int i = 0; i < kTaps; ++i) {
        const ivec2 tap = texelOf(i, at, turn);
        // What lies beside a map counts as lit; in an atlas it would be a texel of another.
        bool shadowed = false;
        if (all(greaterThanEqual(tap, ivec2(0))) && all(lessThan(tap, ivec2(s.side)))) {
            const float stored = texelFetch(depths, ivec3(tap, 0) + map.corner, 0).r;
            if (stored == kUnknownDepth) return kNoSample;
            shadowed = shadows(map, tap, stored, compared, s.mostFall * texel, normal);
        }
        lit += shadowed ? 0.0 : weightOf(i, at);
    }
    const vec2 away = abs(at - s.side / 2.0);
    return Sample(true, min(lit, 1.0), v, max(away.x, away.y) / (s.side / 2.0 - s.reach));
}

/// How much of the next map is mixed into a map's answer.
float blendOf(Sample found, float depth) {
    if (s.blend <= 0.0) return 0.0;
    const vec2 interval = s.views[found.view].interval;
    const float through = s.byInterval ? (depth - interval.x) / (interval.y - interval.x) : found.outward;
    return clamp((through - (1.0 - s.blend)) / s.blend, 0.0, 1.0);
}

Answer lightAt(Receiver receiver) {
    const vec3 p = s.lightFromWorld * receiver.pWorld, normal = s.lightFromWorld * receiver.normalWorld;
    const float depth = dot(receiver.pWorld, s.forward);
    Answer answer = Answer(1.0, -1);
    float weight = 0.0;  // of the map that is still asked
    int m = 0;
    if (s.byInterval)
        while (m < s.mapCount && s.views[s.maps[m].first].interval.y < depth) ++m;
    for (; m < s.mapCount; ++m) {
        const Sample found = sampleMap(s.maps[m], p, normal, receiver.pixel);
        if (!found.known) continue;
        if (answer.view >= 0) {
            answer.light = mix(answer.light, found.light, weight);
            break;
        }
        answer = Answer(found.light, found.view);
        weight = blendOf(found, depth);
        if (weight <= 0.0) break;
    }
    if (answer.view >= 0 && s.fade > 0.0) {
        const float gone = (length(receiver.pWorld) / s.far - (1.0 - s.fade)) / s.fade;
        answer.light = mix(answer.light, 1.0, clamp(gone, 0.0, 1.0));
    }
    return answer;
}

void main() {
    const uint threads = gl_NumWorkGroups.x * gl_WorkGroupSize.x;
    for (uint i = gl_GlobalInvocationID.x; i < count; i += threads) answers[i] = lightAt(receivers[i]);
}
