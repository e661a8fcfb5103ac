/** A constructed sheet: pages that forbid inline styles allow it. */
export const styles = new CSSStyleSheet();

styles.replaceSync(`
:host {
  display: block;
  position: relative;
  min-height: 12rem;
  aspect-ratio: 4 / 3;
  overflow: hidden;
  contain: layout paint;
  container-type: inline-size;
}
:host([hidden]) { display: none; }
[hidden] { display: none !important; }
* { box-sizing: border-box; }
.view {
  position: absolute;
  inset: 0;
  font: 13px/1.35 system-ui, sans-serif;
  color: var(--viewer-ink, light-dark(#1b1f24, #e8eaed));
  background-color: var(--viewer-background, light-dark(#eef0f2, #2a2e35));
  /* Its end tells the program that the colours of the page have changed. */
  transition: color 1ms, background-color 1ms;
}
.stage, .stage > canvas { position: absolute; inset: 0; width: 100%; height: 100%; }
.stage { outline: none; touch-action: none; cursor: grab; }
.stage:active { cursor: grabbing; }
.stage.over { cursor: crosshair; }
.marks { pointer-events: none; }
.view:has(.stage:focus-visible)::after {
  content: "";
  position: absolute;
  inset: 0;
  border: 3px solid Highlight;
  border-color: AccentColor;
  pointer-events: none;
}
.panel {
  background: color-mix(in srgb, var(--viewer-background, light-dark(#fff, #1d2026)) 88%, transparent);
  border-radius: 6px;
}
.legend { position: absolute; left: 8px; bottom: 8px; width: 232px; padding: 8px 12px; max-height: calc(100% - 16px); overflow: auto; }
.title { margin: 0 0 4px; font-weight: 600; }
.bar { height: 12px; border-radius: 2px; }
.ticks { position: relative; height: 18px; font-variant-numeric: tabular-nums; }
.ticks span { position: absolute; transform: translateX(-50%); }
.ticks span::before { content: ""; display: block; width: 1px; height: 3px; margin: 0 auto -1px; background: currentColor; }
.bounds { display: flex; align-items: center; gap: 6px; margin-top: 4px; }
.bounds input { flex: 1 1 0; min-width: 0; width: 0; height: 24px; font: inherit; font-variant-numeric: tabular-nums; appearance: textfield; color: inherit; background: transparent; border: 1px solid color-mix(in srgb, currentColor 55%, transparent); border-radius: 4px; padding: 0 4px; }
.bounds button, .gizmo button, .tools button { font: inherit; color: inherit; border: 1px solid color-mix(in srgb, currentColor 55%, transparent); border-radius: 4px; background: transparent; cursor: pointer; }
.bounds button { height: 24px; }
:is(button, input):focus-visible { outline: 2px solid AccentColor; outline-offset: 1px; }
.categories { list-style: none; margin: 0; padding: 0; max-height: 9rem; overflow: auto; }
.categories li { display: flex; align-items: center; gap: 6px; }
.swatch { flex: none; width: 12px; height: 12px; border-radius: 2px; }
.tools { position: absolute; left: 8px; top: 8px; display: flex; gap: 6px; }
.tools button { min-height: 28px; padding: 0 10px; background: var(--viewer-background, light-dark(#fff, #1d2026)); }
.gizmo { position: absolute; top: 4px; right: 4px; width: 96px; height: 96px; pointer-events: none; }
.gizmo svg { position: absolute; inset: 0; }
.gizmo line { stroke: currentColor; stroke-opacity: 0.45; }
.gizmo button { position: absolute; left: 36px; top: 36px; width: 24px; height: 24px; padding: 0; border-radius: 50%; font-weight: 600; font-size: 12px; background: var(--viewer-background, light-dark(#fff, #1d2026)); pointer-events: auto; }
.gizmo button.behind { color: color-mix(in srgb, currentColor 70%, transparent); }
.tooltip { position: absolute; left: 0; top: 0; padding: 6px 10px; pointer-events: none; white-space: nowrap; box-shadow: 0 1px 6px rgb(0 0 0 / 0.3); background: var(--viewer-background, light-dark(#fff, #1d2026)); border-radius: 6px; font-variant-numeric: tabular-nums; }
.tooltip dl { display: grid; grid-template-columns: auto auto; gap: 0 12px; margin: 2px 0 0; }
.tooltip dd { margin: 0; text-align: right; }
.tooltip p { margin: 2px 0 0; max-width: 32ch; white-space: normal; }
.message { position: absolute; inset: 0; display: grid; place-content: center; padding: 16px; text-align: center; margin: 0; }
.hint { position: absolute; left: 50%; top: 12px; translate: -50%; padding: 4px 10px; margin: 0; pointer-events: none; }
.unseen { position: absolute; width: 1px; height: 1px; overflow: hidden; clip-path: inset(50%); white-space: nowrap; }
@container (max-width: 480px) {
  /* There is no room over the model: below it. */
  .view { display: flex; flex-direction: column; }
  .stage { position: relative; flex: 1 1 0; height: auto; min-height: 0; overflow: hidden; }
  .legend { position: static; flex: none; width: auto; max-height: 50%; padding: 6px 10px; border-radius: 0; }
  .categories { max-height: 4.5rem; }
}
`);
