/** What the computer can draw with. */
export interface Graphics {
  /** Drawn by the processor: slow, so that frames have to be cheap. */
  software: boolean;
}

let known: Graphics | null | undefined;

/** Null if the browser has no WebGL 2. */
export function graphics(): Graphics | null {
  if (known === undefined) known = look();
  return known;
}

function look(): Graphics | null {
  const context = document.createElement("canvas").getContext("webgl2");
  if (!context) return null;
  const names = context.getExtension("WEBGL_debug_renderer_info");
  const name: unknown = context.getParameter(names ? names.UNMASKED_RENDERER_WEBGL : context.RENDERER);
  context.getExtension("WEBGL_lose_context")?.loseContext();
  return { software: /swiftshader|llvmpipe|softpipe|software|basic render/i.test(String(name)) };
}
