import { Color, DoubleSide, FrontSide, GLSL3, NormalBlending, RawShaderMaterial } from "three";
import type { Theme } from "./theme";

/** Colours go to the screen as they are, in sRGB, so that they are those of the legend. */

// Light from the eye: what faces it has the colour itself, what is seen edge-on 0.65 of the light. Shading by vertex
// rather than by pixel makes a frame half as dear where the processor draws.
const FACING = `
uniform mat4 modelViewMatrix, projectionMatrix;
in vec3 position, normal;
float facingOf(vec4 place) {
  return abs(dot(normalize(place.xyz), normalize(mat3(modelViewMatrix) * normal)));
}`;

const COLORED_VERTEX = `${FACING}
in vec4 color;
out vec4 tint;
void main() {
  vec4 place = modelViewMatrix * vec4(position, 1.0);
  float facing = facingOf(place);
  float light = pow(mix(0.65, 1.0, facing), 1.0 / 2.2);
  tint = vec4(color.rgb * light * color.a, color.a);
  gl_Position = projectionMatrix * place;
}`;

const COLORED_FRAGMENT = `
precision mediump float;
in vec4 tint;
out vec4 result;
void main() { result = tint; }`;

const GLASS_VERTEX = `${FACING}
uniform float clear, rim;
out float strength;
void main() {
  vec4 place = modelViewMatrix * vec4(position, 1.0);
  float edge = 1.0 - facingOf(place);
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
uniform float strength;
out vec4 result;
void main() { result = vec4(shade, 1.0) * strength; }`;

const TRANSLUCENT = {
  transparent: true,
  depthWrite: false,
  blending: NormalBlending,
  premultipliedAlpha: true,
} as const;

/** One of each kind, for all models: making a program for the graphics card takes longer than a frame. */
export class Materials {
  /** Coloured by node, seen from both sides. */
  readonly solid = coloredMaterial({});
  readonly translucent = coloredMaterial(TRANSLUCENT);
  readonly lines = lineMaterial();
  readonly closed = glassMaterial(0.12, 0.5);
  readonly skin = glassMaterial(0.05, 0.6);

  setTheme({ ink, glass }: Theme): void {
    setShade(this.lines, ink);
    setShade(this.closed, glass);
    setShade(this.skin, glass);
  }

  /** Lines are one pixel of the canvas wide. `pixels`: how many of those are one of the page; wide lines become faint. */
  setLineWidth(pixels: number): void {
    const { strength } = this.lines.uniforms;
    if (strength) strength.value = Math.min(1, Math.sqrt(pixels / 1.5));
  }

  dispose(): void {
    for (const material of [this.solid, this.translucent, this.lines, this.closed, this.skin]) material.dispose();
  }
}

function coloredMaterial(how: Partial<typeof TRANSLUCENT>): RawShaderMaterial {
  return new RawShaderMaterial({
    glslVersion: GLSL3,
    vertexShader: COLORED_VERTEX,
    fragmentShader: COLORED_FRAGMENT,
    side: DoubleSide,
    forceSinglePass: true,
    ...how,
  });
}

/** Like glass: nearly clear where it faces the eye (`clear`), strong at the silhouette (`rim`); both 0 to 1. */
function glassMaterial(clear: number, rim: number): RawShaderMaterial {
  return new RawShaderMaterial({
    glslVersion: GLSL3,
    vertexShader: GLASS_VERTEX,
    fragmentShader: GLASS_FRAGMENT,
    uniforms: { shade: { value: new Color() }, clear: { value: clear }, rim: { value: rim } },
    side: FrontSide,
    ...TRANSLUCENT,
  });
}

function lineMaterial(): RawShaderMaterial {
  return new RawShaderMaterial({
    glslVersion: GLSL3,
    vertexShader: LINE_VERTEX,
    fragmentShader: LINE_FRAGMENT,
    uniforms: { shade: { value: new Color() }, strength: { value: 1 } },
    ...TRANSLUCENT,
    depthWrite: true,
  });
}

/** sRGB, 0 to 255. */
function setShade(material: RawShaderMaterial, [red, green, blue]: readonly [number, number, number]): void {
  const shade: unknown = material.uniforms.shade?.value;
  if (shade instanceof Color) shade.setRGB(red / 255, green / 255, blue / 255);
}
