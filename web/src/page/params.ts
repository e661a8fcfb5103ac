/** A form's fields from the JSON Schema of the parameters, and the parameters from what was filled in. */

/** The part of JSON Schema that parameters are described with. */
export interface Schema {
  type?: string;
  enum?: string[];
  oneOf?: Schema[];
  properties?: Record<string, Schema>;
  additionalProperties?: boolean | Schema;
  propertyNames?: Schema;
  items?: Schema;
  minimum?: number;
  maximum?: number;
  minItems?: number;
  maxItems?: number;
  maxProperties?: number;
  maxLength?: number;
  pattern?: string;
  default?: unknown;
  description?: string;
}

/** One way to give a parameter. */
export type Variant =
  | { kind: "constant"; label: string; value: unknown }
  | { kind: "number"; label: string; input: Input }
  | { kind: "object"; label: string; inputs: Input[] }
  | { kind: "numbers"; label: string; inputs: Input[]; most: number }
  | { kind: "words"; label: string; words: string[]; least: number }
  | { kind: "texts"; label: string; names: RegExp; texts: RegExp; longest: number; most: number };

export interface Input {
  name: string;
  isWhole: boolean;
  minimum?: number;
  maximum?: number;
}

export interface Field {
  name: string;
  about: string;
  variants: Variant[];
  initial: Filled;
}

/** What stands in a field: which variant, and the text of its inputs; of words, those that are taken. */
export interface Filled {
  variant: number;
  texts: string[];
}

/** Leaves a parameter out, for the service to choose. */
const LEFT_OUT: Variant = { kind: "constant", label: "not set", value: undefined };

export function fieldsOf(schema: Schema): Field[] {
  return Object.entries(schema.properties ?? {}).map(([name, property]) => {
    const hasDefault = property.default !== undefined;
    const variants = [...(hasDefault ? [] : [LEFT_OUT]), ...variantsOf(name, property)];
    return { name, about: property.description ?? "", variants, initial: fill(variants, property.default) };
  });
}

function variantsOf(name: string, schema: Schema): Variant[] {
  if (schema.enum !== undefined) return schema.enum.map((value) => ({ kind: "constant", label: value, value }));
  if (schema.type === "number" || schema.type === "integer") {
    return [
      { kind: "number", label: schema.type === "integer" ? "a whole number" : "a number", input: input(name, schema) },
    ];
  }
  if (schema.items !== undefined) return [list(name, schema, schema.items)];
  if (schema.properties !== undefined) {
    const inputs = Object.entries(schema.properties).map(([key, part]) => input(key, part));
    return [{ kind: "object", label: inputs.map((input) => input.name).join(" and "), inputs }];
  }
  if (typeof schema.additionalProperties === "object") return [texts(schema, schema.additionalProperties)];
  return (schema.oneOf ?? []).flatMap((one) => variantsOf(name, one));
}

/** A list of words that there are, or of numbers. */
function list(name: string, { minItems = 0, maxItems = Infinity }: Schema, items: Schema): Variant {
  if (items.enum !== undefined) return { kind: "words", label: "these", words: items.enum, least: minItems };
  const inputs = (items.oneOf ?? [items]).map((one) => input(name, one));
  return { kind: "numbers", label: "these", inputs, most: maxItems };
}

/** Texts by names that are not known before. */
function texts(
  { propertyNames, maxProperties = Infinity }: Schema,
  { pattern, maxLength = Infinity }: Schema,
): Variant {
  const names = new RegExp(propertyNames?.pattern ?? "", "u");
  return {
    kind: "texts",
    label: "these",
    names,
    texts: new RegExp(pattern ?? "", "u"),
    longest: maxLength,
    most: maxProperties,
  };
}

function input(name: string, { type, minimum, maximum }: Schema): Input {
  return {
    name,
    isWhole: type === "integer",
    ...(minimum === undefined ? {} : { minimum }),
    ...(maximum === undefined ? {} : { maximum }),
  };
}

/** How `value` stands in a field with these variants. */
function fill(variants: Variant[], value: unknown): Filled {
  for (const [variant, way] of variants.entries()) {
    if (way.kind === "constant" && way.value === value) return { variant, texts: [] };
    if (way.kind === "number" && typeof value === "number") return { variant, texts: [String(value)] };
    if (way.kind === "object" && isRecord(value) && way.inputs.every((input) => input.name in value)) {
      return { variant, texts: way.inputs.map((input) => String(value[input.name])) };
    }
    if (way.kind === "numbers" && Array.isArray(value)) return { variant, texts: [value.join(", ")] };
    if (way.kind === "words" && Array.isArray(value)) return { variant, texts: value.map(String) };
    if (way.kind === "texts" && isRecord(value)) {
      return {
        variant,
        texts: [
          Object.entries(value)
            .map(([name, text]) => `${name}: ${text}`)
            .join("\n"),
        ],
      };
    }
  }
  return { variant: 0, texts: [] };
}

function isRecord(value: unknown): value is Record<string, unknown> {
  return typeof value === "object" && value !== null && !Array.isArray(value);
}

type Read = { value: unknown } | { wrong: string };

/** The value of a field, or what is wrong with what was filled in. */
function read(field: Field, filled: Filled): Read {
  const variant = field.variants[filled.variant];
  switch (variant?.kind) {
    case "number":
      return readNumber(variant.input, filled.texts[0]);
    case "object": {
      const values: Record<string, unknown> = {};
      for (const [at, input] of variant.inputs.entries()) {
        const read = readNumber(input, filled.texts[at]);
        if ("wrong" in read) return read;
        values[input.name] = read.value;
      }
      return { value: values };
    }
    case "numbers":
      return readNumbers(variant, filled.texts[0]);
    case "words": {
      const value = variant.words.filter((word) => filled.texts.includes(word));
      return value.length >= variant.least ? { value } : { wrong: `${field.name}: at least ${variant.least}` };
    }
    case "texts":
      return readTexts(variant, filled.texts[0]);
    default:
      return { value: variant?.value };
  }
}

function readNumber(input: Input, text = ""): Read {
  const { name, isWhole, minimum = -Infinity, maximum = Infinity } = input;
  // A comma of decimals; in whole numbers it may be one of thousands, which is asked back.
  const value = Number(isWhole ? text : text.replace(",", "."));
  const isFit =
    /^\s*[+-]?[\d.,]+(e[+-]?\d+)?\s*$/i.test(text) && Number.isFinite(value) && (!isWhole || Number.isInteger(value));
  return isFit && value >= minimum && value <= maximum ? { value } : { wrong: `${name}: ${told(input)}` };
}

function told({ isWhole, minimum, maximum }: Input): string {
  return `${isWhole ? "a whole number" : "a number"} from ${minimum ?? "−∞"} to ${maximum ?? "∞"}`;
}

function readNumbers({ inputs, most }: Variant & { kind: "numbers" }, text = ""): Read {
  const parts = text.split(/[\s,;]+/).filter((part) => part !== "");
  const value: unknown[] = [];
  for (const part of parts) {
    const read = inputs.map((input) => readNumber(input, part)).find((read) => "value" in read);
    if (read !== undefined && "value" in read && !value.includes(read.value)) value.push(read.value);
  }
  const isFit = parts.length > 0 && parts.length <= most && value.length === parts.length;
  return isFit
    ? { value }
    : { wrong: `each once, separated by commas, at most ${most}: ${inputs.map(told).join(", or ")}` };
}

/** A line for each: the name, a colon, the text. */
function readTexts({ names, texts, longest, most }: Variant & { kind: "texts" }, text = ""): Read {
  const lines = text.split("\n").filter((line) => line.trim() !== "");
  const value = new Map<string, string>();
  for (const line of lines) {
    const at = line.indexOf(":");
    const [name, said] = [line.slice(0, at).trim(), line.slice(at + 1).trim()];
    if (at >= 0 && names.test(name) && texts.test(said) && [...said].length <= longest) value.set(name, said);
  }
  return value.size === lines.length && lines.length <= most
    ? { value: Object.fromEntries(value) }
    : { wrong: `one to a line, such as 11: text, each number once, a text of at most ${longest} characters` };
}

/** The parameters that differ from what the service would take anyway; what is wrong, by field. */
export function assemble(fields: Field[], form: Record<string, Filled>) {
  const params: Record<string, unknown> = {};
  const wrong: Record<string, string> = {};
  for (const field of fields) {
    const given = read(field, form[field.name] ?? field.initial);
    const untouched = read(field, field.initial);
    if ("wrong" in given) wrong[field.name] = given.wrong;
    else if (JSON.stringify(given) !== JSON.stringify(untouched)) params[field.name] = given.value;
  }
  return { params, wrong };
}
