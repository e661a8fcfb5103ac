import { Color, DoubleSide, FrontSide, GLSL3, NormalBlending, RawShaderMaterial } from "three";

/** Colours go to the screen as they are, in sRGB, so that they are those of the legend. */

const COLORED_VERTEX = `
uniform mat4 modelViewMatrix, projectionMatrix;
in vec3 position, normal;
in vec4 color;
out vec4 tint;
out vec3 toEye, across;
void main() {
  vec4 place = modelViewMatrix * vec4(position, 1.0);
  tint = color;
  toEye = -place.xyz;
  across = mat3(modelViewMatrix) * normal;
  gl_Position = projectionMatrix * place;
}`;

// Light from the eye: what faces it has the colour itself, what is seen edge-on 0.65 of the light.
const COLORED_FRAGMENT = `
precision highp float;
in vec4 tint;
in vec3 toEye, across;
out vec4 result;
void main() {
  float facing = abs(dot(normalize(toEye), normalize(across)));
  float light = pow(mix(0.65, 1.0, facing), 1.0 / 2.2);
  result = vec4(tint.rgb * light * tint.a, tint.a);
}`;

// Per vertex: the skin has so many that this is fine enough, and it keeps the frame cheap.
const GLASS_VERTEX = `
uniform mat4 modelViewMatrix, projectionMatrix;
uniform float clear, rim;
in vec3 position, normal;
out float strength;
void main() {
  vec4 place = modelViewMatrix * vec4(position, 1.0);
  float facing = abs(dot(normalize(place.xyz), normalize(mat3(modelViewMatrix) * normal)));
  float edge = 1.0 - facing;
  strength = mix(clear, rim, edge * edge * sqrt(edge));
  gl_Position = projectionMatrix * place;
}`;

const GLASS_FRAGMENT = `
precision mediump float;
uniform vec3 shade;
in float strength;
out vec4 result;
void main() { result = vec4(shade * strength, strength); }`;

const LINE_VERTEX = `
uniform mat4 modelViewMatrix, projectionMatrix;
in vec3 position;
void main() { gl_Position = projectionMatrix * modelViewMatrix * vec4(position, 1.0); }`;

const LINE_FRAGMENT = `
precision mediump float;
uniform vec3 shade;
out vec4 result;
void main() { result = vec4(shade, 1.0); }`;

/** Coloured by node, seen from both sides. */
export function coloredMaterial(translucent: boolean): RawShaderMaterial {
  return new RawShaderMaterial({
    glslVersion: GLSL3,
    vertexShader: COLORED_VERTEX,
    fragmentShader: COLORED_FRAGMENT,
    side: DoubleSide,
    forceSinglePass: true,
    ...(translucent ? TRANSLUCENT : {}),
  });
}

/** Like glass: nearly clear where it faces the eye (`clear`), strong at the silhouette (`rim`); both 0 to 1. */
export function glassMaterial(clear: number, rim: number): RawShaderMaterial {
  return new RawShaderMaterial({
    glslVersion: GLSL3,
    vertexShader: GLASS_VERTEX,
    fragmentShader: GLASS_FRAGMENT,
    uniforms: { shade: { value: new Color() }, clear: { value: clear }, rim: { value: rim } },
    side: FrontSide,
    ...TRANSLUCENT,
  });
}

export function lineMaterial(): RawShaderMaterial {
  return new RawShaderMaterial({
    glslVersion: GLSL3,
    vertexShader: LINE_VERTEX,
    fragmentShader: LINE_FRAGMENT,
    uniforms: { shade: { value: new Color() } },
  });
}

/** sRGB, 0 to 255. */
export function setShade(material: RawShaderMaterial, [red, green, blue]: readonly [number, number, number]): void {
  const shade: unknown = material.uniforms.shade?.value;
  if (shade instanceof Color) shade.setRGB(red / 255, green / 255, blue / 255);
}

const TRANSLUCENT = {
  transparent: true,
  depthWrite: false,
  blending: NormalBlending,
  premultipliedAlpha: true,
} as const;
