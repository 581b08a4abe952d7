//! The sentences of the web page as JSON, so that its script fills them in by a few lines of its own.
//!
//! A message is a list of parts: a text, `{"value": name}`, `{"message": id}`, or `{"select": name, "of": {variant:
//! parts}, "else": variant}`, whose variants are the plural categories of Unicode (`one`, `other`, ...) for numbers.

use crate::Language;
use fluent_syntax::ast::{Entry, Expression, InlineExpression, Pattern, PatternElement, VariantKey};
use serde_json::{Map, Value, json};

/// The beginning of the ids that the page uses.
const PREFIX: &str = "page-";

/// All sentences of the page in a language, by id.
pub fn page_messages(language: Language) -> Value {
    let mut messages = Map::new();
    for entry in language.resource().entries() {
        if let Entry::Message(message) = entry
            && message.id.name.starts_with(PREFIX)
            && let Some(pattern) = &message.value
        {
            messages.insert(message.id.name.to_owned(), parts(pattern));
        }
    }
    Value::Object(messages)
}

fn parts(pattern: &Pattern<&str>) -> Value {
    let part = |element: &PatternElement<&str>| match element {
        PatternElement::TextElement { value } => json!(value),
        PatternElement::Placeable { expression } => expanded(expression),
    };
    Value::Array(pattern.elements.iter().map(part).collect())
}

fn expanded(expression: &Expression<&str>) -> Value {
    match expression {
        Expression::Inline(inline) => value_of(inline),
        Expression::Select { selector, variants } => {
            let name = |key: &VariantKey<&str>| match key {
                VariantKey::Identifier { name } | VariantKey::NumberLiteral { value: name } => {
                    (*name).to_owned()
                }
            };
            let of: Map<_, _> = variants.iter().map(|v| (name(&v.key), parts(&v.value))).collect();
            let other = variants.iter().find(|v| v.default).map(|v| name(&v.key));
            let InlineExpression::VariableReference { id } = selector else { return Value::Null };
            json!({ "select": id.name, "of": of, "else": other })
        }
    }
}

fn value_of(inline: &InlineExpression<&str>) -> Value {
    match inline {
        InlineExpression::StringLiteral { value } | InlineExpression::NumberLiteral { value } => json!(value),
        InlineExpression::VariableReference { id } => json!({ "value": id.name }),
        InlineExpression::MessageReference { id, .. } => json!({ "message": id.name }),
        InlineExpression::Placeable { expression } => expanded(expression),
        // Functions and terms do not occur in the page's sentences, which a test checks.
        InlineExpression::FunctionReference { .. } | InlineExpression::TermReference { .. } => Value::Null,
    }
}
