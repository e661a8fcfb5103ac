import { Color, Scene, WebGLRenderer } from "three";
import type { Orbit } from "./camera";
import type { Graphics } from "./graphics";
import { Materials } from "./materials";
import type { Theme } from "./theme";

/** How long the view has to stand still before it is drawn sharply, ms. */
const REST_MS = 250;
const MOVING_RATIO = 0.75;
const MOST_PIXELS = 2560 * 1600;

/** The canvas of the model. Draws when something has changed, not otherwise. */
export class Stage {
  readonly canvas: HTMLCanvasElement;
  readonly scene = new Scene();
  readonly materials = new Materials();
  #renderer: WebGLRenderer;
  #software: boolean;
  #frame = 0;
  #rest = 0;
  #moving = false;
  #held = false;
  #size = { width: 0, height: 0 };
  /** Width, height and pixels per CSS pixel of the canvas. */
  #buffer = [0, 0, 0];
  #draw: () => void;

  /** `draw` is called for each frame and calls `render`. */
  constructor({ canvas, context, software }: Graphics, draw: () => void) {
    this.canvas = canvas;
    this.#software = software;
    this.#draw = draw;
    this.#renderer = new WebGLRenderer({ canvas, context });
    // Asking whether the shaders are right waits for them to be compiled.
    this.#renderer.debug.checkShaderErrors = false;
    canvas.addEventListener("webglcontextrestored", this.invalidate);
  }

  get size(): Readonly<{ width: number; height: number }> {
    return this.#size;
  }

  /** The next frame has to be quick. */
  get cheap(): boolean {
    return this.#software && this.#moving;
  }

  /** CSS pixels. */
  resize(width: number, height: number): void {
    this.#size = { width, height };
    this.invalidate();
  }

  setTheme(theme: Theme): void {
    const [red, green, blue] = theme.background;
    this.materials.setTheme(theme);
    const color = new Color(red / 255, green / 255, blue / 255);
    this.#renderer.setClearColor(color.convertSRGBToLinear());
    this.invalidate();
  }

  /** Draws in the next frame. */
  readonly invalidate = (): void => {
    this.#frame ||= requestAnimationFrame(this.drawNow);
  };

  /** Draws in the next frame, fast rather than sharp, and sharply when nothing has moved for a while. */
  moved(): void {
    this.#moving = true;
    this.#restSoon();
    this.invalidate();
  }

  /** While it is held, the view is not at rest, however still the hand is. */
  hold(on: boolean): void {
    this.#held = on;
    if (this.#moving) this.#restSoon();
  }

  readonly drawNow = (): void => {
    cancelAnimationFrame(this.#frame);
    this.#frame = 0;
    if (this.#size.width > 0 && this.#size.height > 0) this.#draw();
  };

  /** Draws sharply at once, for a picture to be taken before the browser does anything else. */
  drawSharply(): void {
    this.#moving = false;
    this.drawNow();
  }

  render(orbit: Orbit): void {
    const { width, height } = this.#size;
    const wanted = [width, height, this.#ratio()] as const;
    if (wanted.some((x, n) => x !== this.#buffer[n])) {
      this.#renderer.setDrawingBufferSize(...wanted);
      this.#buffer = [...wanted];
      this.materials.setLineWidth(wanted[2]);
    }
    this.#renderer.render(this.scene, orbit.camera);
  }

  /** Draws the background alone. */
  clear(): void {
    this.#renderer.clear();
  }

  dispose(): void {
    cancelAnimationFrame(this.#frame);
    clearTimeout(this.#rest);
    this.canvas.removeEventListener("webglcontextrestored", this.invalidate);
    this.materials.dispose();
    this.#renderer.dispose();
    this.#renderer.forceContextLoss();
    this.canvas.remove();
  }

  #restSoon(): void {
    clearTimeout(this.#rest);
    if (this.#held) return;
    this.#rest = window.setTimeout(() => {
      this.#moving = false;
      this.invalidate();
    }, REST_MS);
  }

  /** Pixels of the canvas per CSS pixel. */
  #ratio(): number {
    const { width, height } = this.#size;
    const most = Math.sqrt(MOST_PIXELS / (width * height));
    const wanted = this.#software ? (this.#moving ? MOVING_RATIO : 2) : Math.min(devicePixelRatio, 2);
    return Math.min(wanted, most);
  }
}
