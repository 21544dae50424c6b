/** Draws a mesh's surface with WebGL2: coloured by a number per node, deformed, with edges. */
import { project, rotation, type Camera, type Vec3, type Viewport } from "./camera";
import { colourAt, type Rgb, type Theme } from "./colour";
import type { Box, Range, Surface } from "./mesh";

const vertexSource = `#version 300 es
layout(location=0) in vec3 position;
layout(location=1) in vec3 displacement;
layout(location=2) in float value;
uniform mat3 turn;
uniform vec3 centre;
uniform float factor;
uniform vec2 scale, shift;
uniform float depth, closer;
out vec3 seen;
out float scalar;
void main() {
  seen = turn * (position + factor * displacement - centre);
  scalar = value;
  gl_Position = vec4(seen.xy * scale + shift, -seen.z * depth - closer, 1.0);
}`;

const fragmentSource = `#version 300 es
precision highp float;
in vec3 seen;
in float scalar;
uniform sampler2D colours;
uniform vec2 range;
uniform vec4 plain;
out vec4 colour;
void main() {
  vec3 normal = normalize(cross(dFdx(seen), dFdy(seen)));
  float light = 0.78 + 0.22 * abs(normal.z);
  float at = clamp((scalar - range.x) / (range.y - range.x), 0.0, 1.0);
  vec3 base = plain.a > 0.0 ? plain.rgb : texture(colours, vec2(at * 0.99609375 + 0.001953125, 0.5)).rgb;
  colour = vec4(plain.a > 1.5 ? base : base * light, 1.0);
}`;

export interface Scene {
  camera: Camera;
  view: Viewport;
  pixelsPerMetre: number;
  box: Box;
  factor: number;
  edges: boolean;
  /** Colours by value; without it the surface is plain. */
  colouring?: { range: Range; map: "viridis" | "signed" };
  theme: Theme;
}

export class MeshView {
  private readonly gl: WebGL2RenderingContext;
  private readonly program: WebGLProgram;
  private readonly buffers: Record<"position" | "displacement" | "value" | "triangles" | "edges", WebGLBuffer>;
  private readonly uniforms: Record<string, WebGLUniformLocation | null> = {};
  private readonly textures: Record<"viridis" | "signed", WebGLTexture>;
  private counts = { triangles: 0, edges: 0 };

  /** Throws where the browser has no WebGL2. */
  constructor(private readonly canvas: HTMLCanvasElement) {
    const gl = canvas.getContext("webgl2", { antialias: true, alpha: true, preserveDrawingBuffer: true });
    if (!gl) throw new Error("this browser has no WebGL2");
    this.gl = gl;
    this.program = link(gl);
    for (const name of ["turn", "centre", "factor", "scale", "shift", "depth", "closer", "colours", "range", "plain"])
      this.uniforms[name] = gl.getUniformLocation(this.program, name);
    const buffer = (): WebGLBuffer => gl.createBuffer()!;
    this.buffers = {
      position: buffer(),
      displacement: buffer(),
      value: buffer(),
      triangles: buffer(),
      edges: buffer(),
    };
    this.textures = { viridis: texture(gl, "viridis"), signed: texture(gl, "signed") };
  }

  setMesh(points: readonly number[][], surface: Surface): void {
    const { gl, buffers } = this;
    fill(
      gl,
      gl.ARRAY_BUFFER,
      buffers.position,
      Float32Array.from(points.flatMap((p) => [p[0] ?? 0, p[1] ?? 0, p[2] ?? 0])),
    );
    fill(gl, gl.ARRAY_BUFFER, buffers.displacement, new Float32Array(3 * points.length));
    fill(gl, gl.ARRAY_BUFFER, buffers.value, new Float32Array(points.length));
    fill(gl, gl.ELEMENT_ARRAY_BUFFER, buffers.triangles, surface.triangles);
    fill(gl, gl.ELEMENT_ARRAY_BUFFER, buffers.edges, surface.edges);
    this.counts = { triangles: surface.triangles.length, edges: surface.edges.length };
  }

  setDisplacement(values: readonly number[][]): void {
    fill(
      this.gl,
      this.gl.ARRAY_BUFFER,
      this.buffers.displacement,
      Float32Array.from(values.flatMap((v) => [v[0] ?? 0, v[1] ?? 0, v[2] ?? 0])),
    );
  }

  setValues(values: Float32Array): void {
    fill(this.gl, this.gl.ARRAY_BUFFER, this.buffers.value, values);
  }

  draw(scene: Scene): void {
    const { gl, uniforms } = this;
    const { camera, view, box } = scene;
    gl.viewport(0, 0, this.canvas.width, this.canvas.height);
    gl.clearColor(0, 0, 0, 0);
    gl.clear(gl.COLOR_BUFFER_BIT | gl.DEPTH_BUFFER_BIT);
    gl.enable(gl.DEPTH_TEST);
    gl.useProgram(this.program);
    const [right, up, out] = rotation(camera);
    // Columns of the matrix whose rows these are.
    gl.uniformMatrix3fv(
      uniforms.turn!,
      false,
      [0, 1, 2].flatMap((k) => [right[k]!, up[k]!, out[k]!]),
    );
    gl.uniform3fv(uniforms.centre!, box.centre);
    gl.uniform1f(uniforms.factor!, scene.factor);
    const scale = scene.pixelsPerMetre * camera.zoom;
    gl.uniform2f(uniforms.scale!, (2 * scale) / view.width, (2 * scale) / view.height);
    const origin = project(box.centre as Vec3, box, camera, view, scene.pixelsPerMetre);
    gl.uniform2f(uniforms.shift!, (2 * origin[0]) / view.width - 1, 1 - (2 * origin[1]) / view.height);
    gl.uniform1f(uniforms.depth!, 0.5 / box.radius);
    const range = scene.colouring?.range ?? { low: 0, high: 1 };
    gl.uniform2f(uniforms.range!, range.low, range.high);
    gl.bindTexture(gl.TEXTURE_2D, this.textures[scene.colouring?.map ?? "viridis"]);
    this.attribute(0, this.buffers.position, 3);
    this.attribute(1, this.buffers.displacement, 3);
    this.attribute(2, this.buffers.value, 1);
    gl.uniform1f(uniforms.closer!, 0);
    gl.uniform4f(uniforms.plain!, ...scene.theme.mesh, scene.colouring ? 0 : 1);
    gl.bindBuffer(gl.ELEMENT_ARRAY_BUFFER, this.buffers.triangles);
    gl.drawElements(gl.TRIANGLES, this.counts.triangles, gl.UNSIGNED_INT, 0);
    if (!scene.edges) return;
    // Edges lie on the faces: without a step toward the viewer half of them would be lost.
    gl.uniform1f(uniforms.closer!, 0.002);
    gl.uniform4f(uniforms.plain!, ...scene.theme.edge, 2);
    gl.bindBuffer(gl.ELEMENT_ARRAY_BUFFER, this.buffers.edges);
    gl.drawElements(gl.LINES, this.counts.edges, gl.UNSIGNED_INT, 0);
  }

  private attribute(index: number, buffer: WebGLBuffer, size: number): void {
    const { gl } = this;
    gl.bindBuffer(gl.ARRAY_BUFFER, buffer);
    gl.enableVertexAttribArray(index);
    gl.vertexAttribPointer(index, size, gl.FLOAT, false, 0, 0);
  }
}

function fill(gl: WebGL2RenderingContext, target: number, buffer: WebGLBuffer, values: AllowSharedBufferSource): void {
  gl.bindBuffer(target, buffer);
  gl.bufferData(target, values, gl.DYNAMIC_DRAW);
}

function link(gl: WebGL2RenderingContext): WebGLProgram {
  const program = gl.createProgram()!;
  for (const [type, source] of [
    [gl.VERTEX_SHADER, vertexSource],
    [gl.FRAGMENT_SHADER, fragmentSource],
  ] as const) {
    const shader = gl.createShader(type)!;
    gl.shaderSource(shader, source);
    gl.compileShader(shader);
    gl.attachShader(program, shader);
  }
  gl.linkProgram(program);
  if (!gl.getProgramParameter(program, gl.LINK_STATUS))
    throw new Error(gl.getProgramInfoLog(program) ?? "shaders do not link");
  return program;
}

function texture(gl: WebGL2RenderingContext, map: "viridis" | "signed"): WebGLTexture {
  const made = gl.createTexture()!;
  const bytes = Uint8Array.from({ length: 256 }, (_, i) => i).reduce((all, i) => {
    const c: Rgb = colourAt(map, i / 255);
    all.set([...c, 255], 4 * i);
    return all;
  }, new Uint8Array(1024));
  gl.bindTexture(gl.TEXTURE_2D, made);
  gl.texImage2D(gl.TEXTURE_2D, 0, gl.RGBA, 256, 1, 0, gl.RGBA, gl.UNSIGNED_BYTE, bytes);
  for (const name of [gl.TEXTURE_MIN_FILTER, gl.TEXTURE_MAG_FILTER]) gl.texParameteri(gl.TEXTURE_2D, name, gl.LINEAR);
  for (const name of [gl.TEXTURE_WRAP_S, gl.TEXTURE_WRAP_T]) gl.texParameteri(gl.TEXTURE_2D, name, gl.CLAMP_TO_EDGE);
  return made;
}
