import { QUANTITIES, type Quantity } from "../model/quantity";
import type { View } from "./view";

/** Which layers are shown, and what their colours say. */
export function LayerPanel({ view }: { view: View }) {
  const { style } = view;
  return (
    <>
      <label class="field">
        Colour by
        <select value={style.color.value} onChange={(event) => style.colorBy(event.currentTarget.value as Quantity)}>
          {view.quantities.value.map((quantity) => (
            <option key={quantity} value={quantity}>
              {QUANTITIES[quantity].label}
            </option>
          ))}
        </select>
      </label>
      <fieldset class="checks">
        <legend>Layers</legend>
        {view.layerNames.value.map(([layer, label]) => (
          <label class="check" key={layer}>
            <input
              type="checkbox"
              name={layer}
              checked={style.layers.value.has(layer)}
              onChange={(event) => style.setLayer(layer, event.currentTarget.checked)}
            />
            {label}
          </label>
        ))}
      </fieldset>
    </>
  );
}
