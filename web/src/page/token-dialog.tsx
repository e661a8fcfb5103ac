import { useEffect, useRef } from "preact/hooks";
import { type Problem, token, tokenWanted } from "../api/client";

/** Asks for the token when the service wants one. It is kept in memory, never stored, never in the address. */
export function TokenDialog() {
  const dialog = useRef<HTMLDialogElement>(null);
  const input = useRef<HTMLInputElement>(null);
  const wanted = tokenWanted.value;
  useEffect(() => {
    if (wanted !== null && dialog.current?.open === false) dialog.current.showModal();
  }, [wanted]);
  const give = (event: SubmitEvent) => {
    event.preventDefault();
    const given = input.current?.value.trim() ?? "";
    dialog.current?.close();
    tokenWanted.value = null;
    // The same token again is tried again, too.
    if (token.peek() === given) token.value = null;
    token.value = given;
  };
  const forget = () => {
    // The event comes late: it may have been opened again.
    if (dialog.current?.open) return;
    if (input.current) input.current.value = "";
    tokenWanted.value = null;
  };
  return (
    <dialog ref={dialog} aria-labelledby="token-title" onClose={forget}>
      <form onSubmit={give}>
        <h2 id="token-title">Token</h2>
        <p>{reason(wanted)}</p>
        <label class="field">
          Token
          <input
            ref={input}
            type="password"
            autocomplete="off"
            spellcheck={false}
            required
            pattern="[\x21-\x7e]+"
            title="letters, digits and signs without spaces"
          />
        </label>
        <p class="hint">
          It stays in the memory of this page until you close or reload it. The operator makes one with{" "}
          <code>medialrep token create</code>.
        </p>
        <div class="row">
          <button type="submit" class="primary">
            Go on
          </button>
          <button type="button" onClick={() => dialog.current?.close()}>
            Not now
          </button>
        </div>
      </form>
    </dialog>
  );
}

function reason(wanted: Problem | "by hand" | null): string {
  if (wanted === "by hand" || wanted === null) return "Jobs belong to whom the token belongs to.";
  return token.value === null ? "This service wants a token." : `The token was refused: ${wanted.detail}.`;
}
