// The page's sentences in the language of its reader: the catalogue as the server sends it, and what fills it in.

export class Words {
  // A message is a list of parts: texts, values, other messages, and choices by a value or by its plural form.
  constructor(catalogue) {
    Object.assign(this, catalogue);
    this.plurals = new Intl.PluralRules(this.language);
    this.whole = new Intl.NumberFormat(this.language, { useGrouping: false });
  }

  static async in(language) {
    const answer = await fetch(`words/${language}.json`);
    if (!answer.ok) throw new Error(`no sentences in ${language}`);
    return new Words(await answer.json());
  }

  text(id, values = {}) {
    return id in this.messages ? this.fill(this.messages[id], values) : id;
  }

  // A number with its decimals in the language's way.
  number(value, decimals) {
    const digits = { minimumFractionDigits: decimals, maximumFractionDigits: decimals, useGrouping: false };
    return new Intl.NumberFormat(this.language, digits).format(value);
  }

  // Texts and labels of the document.
  show(document) {
    document.documentElement.lang = this.language;
    for (const element of document.querySelectorAll('[data-text]')) element.textContent = this.text(element.dataset.text);
    for (const element of document.querySelectorAll('[data-label]')) element.ariaLabel = this.text(element.dataset.label);
  }

  fill(parts, values) {
    return parts.map((part) => this.part(part, values)).join('');
  }

  part(part, values) {
    if (typeof part === 'string') return part;
    if ('message' in part) return this.text(part.message, values);
    if ('value' in part) {
      const value = values[part.value];
      return typeof value === 'number' ? this.whole.format(value) : String(value ?? '');
    }
    const value = values[part.select];
    const exact = String(value);
    const variant = exact in part.of || typeof value !== 'number' ? exact : this.plurals.select(value);
    return this.fill(part.of[variant] ?? part.of[part.else], values);
  }
}
