/** A canvas that can be drawn on in 3D. */
export interface Graphics {
  canvas: HTMLCanvasElement;
  context: WebGL2RenderingContext;
  /** Drawn by the processor: slow, so that frames have to be cheap. */
  software: boolean;
}

/** Null if the browser has no WebGL 2. */
export function openGraphics(): Graphics | null {
  const plain = open(false);
  if (!plain) return null;
  // Smoothing by the processor costs more than drawing at twice the size at rest. Which it is can only be asked of
  // a context, and making one takes long only where it is the processor.
  if (isSoftware(plain.context)) return { ...plain, software: true };
  const smooth = open(true);
  if (smooth) plain.context.getExtension("WEBGL_lose_context")?.loseContext();
  return { ...(smooth ?? plain), software: false };
}

function open(antialias: boolean): { canvas: HTMLCanvasElement; context: WebGL2RenderingContext } | null {
  const canvas = document.createElement("canvas");
  const context = canvas.getContext("webgl2", { alpha: false, antialias, stencil: false });
  return context && { canvas, context };
}

function isSoftware(context: WebGL2RenderingContext): boolean {
  const names = context.getExtension("WEBGL_debug_renderer_info");
  const name: unknown = context.getParameter(names ? names.UNMASKED_RENDERER_WEBGL : context.RENDERER);
  return /swiftshader|llvmpipe|softpipe|software|basic render/i.test(String(name));
}
