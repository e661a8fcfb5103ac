import { useSignal, useSignalEffect } from "@preact/signals";
import { useEffect, useRef } from "preact/hooks";
import type { NodeInfo } from "../model/node-info";
import { type CameraState, MedialViewer } from "../viewer";
import { LAYER_NAMES, type View } from "./view";

interface Props {
  glb: ArrayBuffer;
  view: View;
  label: string;
}

/** The 3D view as a part of the page: follows the state of `view`, and tells it what is pointed at. */
export function Viewer({ glb, view, label }: Props) {
  const holder = useRef<HTMLDivElement>(null);
  const element = useRef<MedialViewer | null>(null);
  element.current ??= new MedialViewer();
  const viewer = element.current;
  const isLoaded = useSignal(false);
  useEffect(() => {
    let isGone = false;
    isLoaded.value = false;
    holder.current?.append(viewer);
    viewer.load(glb, view.numbers).then(
      () => {
        if (isGone) return;
        viewer.difference = view.difference;
        viewer.camera = view.partner?.viewer.peek()?.camera ?? viewer.camera;
        isLoaded.value = true;
        viewer.dataset.state = "ready";
      },
      // What cannot be shown is told by the element itself.
      () => {},
    );
    view.viewer.value = viewer;
    return () => {
      isGone = true;
      viewer.remove();
    };
  }, [glb, view, viewer, isLoaded]);
  useEffect(() => listen(viewer, view), [viewer, view]);
  useEffect(() => viewer.setAttribute("label", label), [viewer, label]);
  useSignalEffect(() => {
    for (const [layer] of LAYER_NAMES) viewer.setLayer(layer, view.style.layers.value.has(layer));
  });
  useSignalEffect(() => {
    // A new model begins with everything shown.
    if (!isLoaded.value) return;
    const hidden = view.style.hidden.value;
    for (const { index, figures } of view.result.structures) {
      viewer.setStructure(index, !hidden.has(`${index}`));
      for (const figure of figures) viewer.setFigure(index, figure.index, !hidden.has(`${index}/${figure.index}`));
    }
  });
  useSignalEffect(() => {
    viewer.color = view.style.color.value;
    viewer.defaultRange = view.partner && view.dataRange.value;
    viewer.range = view.style.range.value;
  });
  useSignalEffect(() => viewer.mark(view.hovered.value));
  return <div class="viewer" ref={holder} />;
}

/** Passes on what happens in the 3D view, until the function it returns is called. */
function listen(viewer: MedialViewer, view: View): () => void {
  const listening = new AbortController();
  const on = <T,>(type: string, heard: (detail: T) => void) =>
    viewer.addEventListener(type, (event) => heard((event as CustomEvent<T>).detail), { signal: listening.signal });
  on<NodeInfo | null>("nodehover", (node) => view.point(node));
  on<NodeInfo[]>("nodepick", (nodes) => {
    view.picked.value = nodes;
    const last = nodes.at(-1);
    if (last) view.showFlat(last.structure, last.figure);
  });
  on("rangechange", () => {
    view.style.range.value = viewer.range;
  });
  on<CameraState>("camerachange", (camera) => {
    const other = view.partner?.viewer.peek();
    if (other) other.camera = camera;
  });
  return () => listening.abort();
}
