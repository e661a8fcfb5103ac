import type { Field, Filled, Input, Variant } from "./params";

interface Props {
  fields: Field[];
  form: Record<string, Filled>;
  /** What is wrong, by field. */
  wrong: Record<string, string>;
  onChange(name: string, filled: Filled): void;
}

/** A row for each parameter: which way to give it, and its numbers. */
export function ParamsForm({ fields, form, wrong, onChange }: Props) {
  return (
    <div class="params">
      {fields.map((field) => (
        <ParamRow
          key={field.name}
          field={field}
          filled={form[field.name] ?? field.initial}
          wrong={wrong[field.name]}
          onChange={(filled) => onChange(field.name, filled)}
        />
      ))}
    </div>
  );
}

interface RowProps {
  field: Field;
  filled: Filled;
  wrong: string | undefined;
  onChange(filled: Filled): void;
}

function ParamRow({ field, filled, wrong, onChange }: RowProps) {
  const id = `param-${field.name}`;
  const choose = (index: number) =>
    onChange({ variant: index, texts: index === field.initial.variant ? field.initial.texts : [] });
  return (
    <fieldset class="param" aria-describedby={`${id}-about`}>
      <legend>{field.name}</legend>
      <div class="row">
        {field.variants.length > 1 && (
          <select
            aria-label={`${field.name}: how to set it`}
            value={filled.variant}
            onChange={(event) => choose(Number(event.currentTarget.value))}
          >
            {field.variants.map((way, index) => (
              <option key={way.label} value={index}>
                {way.label}
              </option>
            ))}
          </select>
        )}
        <Inputs
          name={field.name}
          variant={field.variants[filled.variant]}
          texts={filled.texts}
          isWrong={wrong !== undefined}
          toldBy={wrong === undefined ? `${id}-about` : `${id}-wrong`}
          onChange={(texts) => onChange({ ...filled, texts })}
        />
      </div>
      {wrong !== undefined && (
        <p class="wrong" id={`${id}-wrong`}>
          {wrong}
        </p>
      )}
      <p class="hint" id={`${id}-about`}>
        {field.about}
      </p>
    </fieldset>
  );
}

interface InputsProps {
  name: string;
  variant: Variant | undefined;
  texts: string[];
  isWrong: boolean;
  /** The element that says what is wanted. */
  toldBy: string;
  onChange(texts: string[]): void;
}

/** What one variant is filled in with. */
function Inputs(props: InputsProps) {
  const { name, variant, texts, isWrong, toldBy, onChange } = props;
  if (variant?.kind === "words") return <Words {...props} words={variant.words} />;
  if (variant?.kind === "texts") {
    return (
      <textarea
        rows={3}
        aria-label={name}
        aria-invalid={isWrong}
        aria-describedby={toldBy}
        placeholder="11: text"
        value={texts[0] ?? ""}
        onInput={(event) => onChange([event.currentTarget.value])}
      />
    );
  }
  const inputs = inputsOf(variant);
  const write = (at: number, text: string) =>
    onChange(inputs.map((_, index) => (index === at ? text : (texts[index] ?? ""))));
  return inputs.map((input, at) => (
    <input
      key={input.name}
      type="text"
      inputMode={input.isWhole ? "numeric" : "decimal"}
      aria-label={input.name === name ? name : `${name}: ${input.name}`}
      aria-invalid={isWrong}
      aria-describedby={toldBy}
      placeholder={placeholder(input)}
      value={texts[at] ?? ""}
      onInput={(event) => write(at, event.currentTarget.value)}
    />
  ));
}

/** A box to tick for each word. */
function Words({ words, texts, toldBy, onChange }: InputsProps & { words: string[] }) {
  const take = (word: string, isTaken: boolean) => {
    const others = texts.filter((text) => text !== word);
    onChange(isTaken ? [...others, word] : others);
  };
  return words.map((word) => (
    <label key={word}>
      <input
        type="checkbox"
        checked={texts.includes(word)}
        aria-describedby={toldBy}
        onChange={(event) => take(word, event.currentTarget.checked)}
      />
      {word}
    </label>
  ));
}

/** The text inputs of a variant. */
function inputsOf(variant: Variant | undefined): Input[] {
  switch (variant?.kind) {
    case "number":
      return [variant.input];
    case "object":
      return variant.inputs;
    case "numbers":
      return [{ name: "list", isWhole: false }];
    default:
      return [];
  }
}

function placeholder({ name, minimum, maximum }: Input): string {
  if (minimum === undefined || maximum === undefined) return name === "list" ? "11, 12" : name;
  return `${minimum} to ${maximum}`;
}
