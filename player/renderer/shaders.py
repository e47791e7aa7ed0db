"""The shaders: surfaces, sky, what can be seen through laid over them, and text over the picture.

Surfaces are drawn relative to the eye in grid units: whole numbers subtract exactly in float32, so nothing trembles far
from the origin. Light comes from the sky, from the ground, from one soft lamp above the viewer's shoulder, and from the
viewer's head. Alpha is 1 where an opaque surface was drawn, else 0. What can be seen through is lit alike, and goes
into the sums of player.renderer.targets.layers.
"""

from __future__ import annotations

from player.renderer.instances import RECORDS_PER_ROW
from storage.meshes.normals import LIMIT

_SURFACE_VERTEX = """
uniform mat4 u_clip;        // grid units relative to the eye -> clip coordinates
uniform vec3 u_eye_whole;   // the eye in grid units: whole part ...
uniform vec3 u_eye_rest;    // ... and the rest
uniform sampler2D u_records;

in vec3 in_position;
in ivec2 in_normal;
in vec4 in_colour;

out vec3 v_relative;
out vec3 v_normal;
out vec3 v_colour;
#if SEE_THROUGH
out float v_alpha;
#endif

#if MULTI_DRAW
in uvec2 in_record;         // placement, tint
uvec2 record() { return in_record; }
#else
uniform usampler2D u_order;
uniform int u_first;
uvec2 record() {
    int i = u_first + gl_InstanceID;
    return texelFetch(u_order, ivec2(i & 4095, i >> 12), 0).rg;
}
#endif

vec3 unpack_normal(ivec2 folded) {
    vec2 e = vec2(folded) * (1.0 / OCTAHEDRAL_LIMIT.0);
    vec3 n = vec3(e, 1.0 - abs(e.x) - abs(e.y));
    if (n.z < 0.0) {
        n.xy = (1.0 - abs(n.yx)) * vec2(n.x >= 0.0 ? 1.0 : -1.0, n.y >= 0.0 ? 1.0 : -1.0);
    }
    return n;
}

void main() {
    vec3 normal = unpack_normal(in_normal);
    vec3 placed = in_position;
    vec3 whole = vec3(0.0);
    vec3 rest = vec3(0.0);
    uvec2 own = record();
    if (own.x != 0u) {
        ivec2 texel = ivec2(int(own.x % RECORDS_PER_ROWu) * 4, int(own.x / RECORDS_PER_ROWu));
        vec4 r0 = texelFetch(u_records, texel, 0);
        vec4 r1 = texelFetch(u_records, texel + ivec2(1, 0), 0);
        vec4 r2 = texelFetch(u_records, texel + ivec2(2, 0), 0);
        rest = texelFetch(u_records, texel + ivec2(3, 0), 0).xyz;
        whole = vec3(r0.w, r1.w, r2.w);
        placed = vec3(dot(r0.xyz, placed), dot(r1.xyz, placed), dot(r2.xyz, placed));
        // Normals turn with the cofactor matrix; its sign is that of the determinant, so mirrored ones turn over too.
        vec3 c0 = cross(r1.xyz, r2.xyz);
        vec3 c1 = cross(r2.xyz, r0.xyz);
        vec3 c2 = cross(r0.xyz, r1.xyz);
        normal = vec3(dot(c0, normal), dot(c1, normal), dot(c2, normal)) * sign(dot(r0.xyz, c0));
    }
    vec3 relative = (placed + (whole - u_eye_whole)) + (rest - u_eye_rest);
    v_relative = relative;
    v_normal = normal;
    vec4 tint = vec4((uvec4(own.y) >> uvec4(0u, 8u, 16u, 24u)) & 255u) / 255.0;
    v_colour = mix(in_colour.rgb, tint.rgb, tint.a);
#if SEE_THROUGH
    v_alpha = in_colour.a;
#endif
    gl_Position = u_clip * vec4(relative, 1.0);
}
"""

_SURFACE_FRAGMENT = """
uniform vec3 u_up;
uniform vec3 u_lamp;        // unit vector towards the lamp
uniform float u_fog;        // per grid unit; 0: no fog
uniform vec3 u_horizon;     // colour of the sky's horizon, linear

in vec3 v_relative;
in vec3 v_normal;
in vec3 v_colour;
#if SEE_THROUGH
in float v_alpha;
layout(location = 0) out vec4 f_sum;
layout(location = 1) out float f_weight;
#else
out vec4 f_colour;
#endif

void main() {
    vec3 to_eye = normalize(-v_relative);
    vec3 face = cross(dFdx(v_relative), dFdy(v_relative));
    face = dot(face, to_eye) < 0.0 ? -face : face;
    // The side that is seen is the side that is lit, whichever way the model's faces were wound.
    vec3 normal = dot(v_normal, v_normal) > 1e-12 ? normalize(v_normal) : normalize(face);
    normal = dot(normal, face) < 0.0 ? -normal : normal;

    vec3 albedo = v_colour * v_colour;  // sRGB is close enough to gamma 2
    float sky = 0.5 + 0.5 * dot(normal, u_up);
    vec3 ambient = mix(vec3(0.21, 0.195, 0.18), vec3(0.40, 0.44, 0.50), sky);
    float lamp = max(dot(normal, u_lamp), 0.0);
    float head = max(dot(normal, to_eye), 0.0);
    vec3 light = ambient + vec3(0.36, 0.335, 0.30) * lamp + vec3(0.25) * head;
    vec3 shine = vec3(0.03) * pow(head, 32.0);
    vec3 colour = albedo * light + shine;
    colour = 1.4 * colour / (1.0 + 0.4 * colour);  // lifts what is dark, keeps what is white below white
    colour = mix(u_horizon, colour, exp(-u_fog * length(v_relative)));
#if SEE_THROUGH
    float alpha = clamp(v_alpha, 0.0, 1.0);
    f_weight = alpha / length(v_relative);
    f_sum = vec4(clamp(colour, 0.0, 1.0) * f_weight, alpha);
#else
    f_colour = vec4(sqrt(clamp(colour, 0.0, 1.0)), 1.0);
#endif
}
"""

_SKY_VERTEX = """#version 330
uniform mat3 u_rays;        // columns: half width, half height, forward
out vec3 v_ray;
void main() {
    vec2 corner = vec2(gl_VertexID == 1 ? 3.0 : -1.0, gl_VertexID == 2 ? 3.0 : -1.0);
    v_ray = u_rays * vec3(corner, 1.0);
    gl_Position = vec4(corner, 0.5, 1.0);
}
"""

_SKY_FRAGMENT = """#version 330
uniform vec3 u_up;
uniform vec3 u_horizon;
in vec3 v_ray;
out vec4 f_colour;
void main() {
    float height = dot(normalize(v_ray), u_up);
    vec3 zenith = vec3(0.16, 0.32, 0.62);
    vec3 ground = vec3(0.36, 0.35, 0.34);
    vec3 colour = height > 0.0
        ? mix(u_horizon, zenith, 1.0 - exp(-2.6 * height))
        : mix(u_horizon, ground, 1.0 - exp(6.0 * height));
    f_colour = vec4(sqrt(colour), 0.0);
}
"""

_OVERLAY_VERTEX = """#version 330
void main() {
    gl_Position = vec4(gl_VertexID == 1 ? 3.0 : -1.0, gl_VertexID == 2 ? 3.0 : -1.0, 0.5, 1.0);
}
"""

_OVERLAY_FRAGMENT = """
uniform SAMPLER u_opaque;   // sRGB
uniform SAMPLER u_sums;     // weighted colours, linear; what all surfaces together let through
uniform SAMPLER u_weights;
out vec4 f_colour;
void main() {
    ivec2 at = ivec2(gl_FragCoord.xy);
    bool covered = false;
    vec3 total = vec3(0.0);
    for (int i = 0; i < SAMPLES; i++) {
        vec3 seen = texelFetch(u_opaque, at, i).rgb;
        float weight = texelFetch(u_weights, at, i).r;
        if (weight > 0.0) {
            vec4 sums = texelFetch(u_sums, at, i);
            seen = sqrt(mix(sums.rgb / weight, seen * seen, sums.a));
            covered = true;
        }
        total += seen;
    }
    if (!covered) {
        discard;
    }
    f_colour = vec4(total / float(SAMPLES), 1.0);
}
"""

_TEXT_VERTEX = """#version 330
in vec2 in_position;        // pixels from the top left corner
in vec2 in_texture;
in vec4 in_colour;
uniform vec2 u_size;        // of the picture in pixels
out vec2 v_texture;
out vec4 v_colour;
void main() {
    v_texture = in_texture;
    v_colour = in_colour;
    gl_Position = vec4(2.0 * in_position.x / u_size.x - 1.0, 1.0 - 2.0 * in_position.y / u_size.y, 0.5, 1.0);
}
"""

_TEXT_FRAGMENT = """#version 330
uniform sampler2D u_atlas;
in vec2 v_texture;
in vec4 v_colour;
out vec4 f_colour;
void main() {
    f_colour = vec4(v_colour.rgb, v_colour.a * texture(u_atlas, v_texture).r);
}
"""

#: The horizon's colour, linear.
HORIZON = (0.72, 0.78, 0.84)

SKY = (_SKY_VERTEX, _SKY_FRAGMENT)
TEXT = (_TEXT_VERTEX, _TEXT_FRAGMENT)


def surface(*, multi_draw: bool, see_through: bool) -> tuple[str, str]:
    """Vertex and fragment shader of surfaces.

    multi_draw: records come as an attribute with base instance (OpenGL 4.3); otherwise from a texture (3.3);
    see_through: what they make goes into the sums of player.renderer.targets.layers; otherwise it is opaque.
    """
    version = "#version 430\n" if multi_draw else "#version 330\n"
    version += f"#define MULTI_DRAW {int(multi_draw)}\n#define SEE_THROUGH {int(see_through)}\n"
    vertex = _SURFACE_VERTEX.replace("RECORDS_PER_ROW", str(RECORDS_PER_ROW)).replace("OCTAHEDRAL_LIMIT", str(LIMIT))
    return version + vertex, version + _SURFACE_FRAGMENT


def overlay(samples: int) -> tuple[str, str]:
    """Vertex and fragment shader that lay the sums of player.renderer.targets.layers over the opaque picture.

    samples: of a pixel in all three of their textures; 0: one, without multisampling. A texel is fetched by its sample
    where it has several, and else by its level of detail, which is 0.
    """
    sampler = "sampler2DMS" if samples else "sampler2D"
    head = f"#version 330\n#define SAMPLER {sampler}\n#define SAMPLES {max(samples, 1)}\n"
    return _OVERLAY_VERTEX, head + _OVERLAY_FRAGMENT
