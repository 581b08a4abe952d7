#![doc = include_str!("../README.md")]

use proc_macro2::{TokenStream, TokenTree};
use quote::quote;
use syn::parse::ParseStream;
use syn::{Attribute, Data, DeriveInput, Error, Expr, ExprLit, Field, Fields, Lit, Meta, Token};

/// Implements `Settings` and `Default` for a struct with named fields. Every field needs a doc comment, which is its help,
/// and one attribute:
///
/// - `#[setting(default = VALUE)]`, `#[setting(default = VALUE, range = LOW..=HIGH)]`: an entry;
/// - `#[setting(section)]`, `#[setting(section, default = VALUE)]`: a struct of settings, in a section of its own;
/// - `#[setting(flatten)]`: a struct of settings whose entries stand beside these;
/// - `#[setting(skip, default = VALUE)]`: a field that a file cannot set.
#[proc_macro_derive(Settings, attributes(setting))]
pub fn derive(input: proc_macro::TokenStream) -> proc_macro::TokenStream {
    syn::parse(input).and_then(|input| expand(&input)).unwrap_or_else(Error::into_compile_error).into()
}

/// What the attribute of a field says.
#[derive(Default)]
struct FieldAttribute {
    default: Option<TokenStream>,
    range: Option<(TokenStream, TokenStream)>,
    section: bool,
    flatten: bool,
    skip: bool,
}

fn expand(input: &DeriveInput) -> syn::Result<TokenStream> {
    let Data::Struct(data) = &input.data else {
        return Err(Error::new_spanned(input, "settings are a struct"));
    };
    let Fields::Named(fields) = &data.fields else {
        return Err(Error::new_spanned(&data.fields, "settings have names"));
    };
    let (mut entries, mut sections, mut defaults) = (Vec::new(), Vec::new(), Vec::new());
    for field in &fields.named {
        let told = field_attribute(field)?;
        let (name, help) = (&field.ident, help(&field.attrs)?);
        let Some(name) = name else { continue };
        let key = name.to_string();
        if help.is_empty() {
            return Err(Error::new_spanned(field, "a setting needs a doc comment: it is its help"));
        }
        if told.flatten {
            sections.push(quote! { ::cairn_settings::Settings::list(&self.#name, path, out); });
        } else if told.section {
            sections.push(quote! { ::cairn_settings::list_section(&self.#name, path, #key, #help, out); });
        } else if !told.skip {
            let range = match &told.range {
                Some((low, high)) => quote! { ::core::option::Option::Some([#low as f64, #high as f64]) },
                None => quote! { ::core::option::Option::None },
            };
            entries
                .push(quote! { ::cairn_settings::list_entry(&self.#name, path, #key, #help, #range, out); });
        }
        defaults.push(match told.default {
            Some(value) => quote! { #name: #value },
            None if told.section || told.flatten => quote! { #name: ::core::default::Default::default() },
            None => return Err(Error::new_spanned(field, "write #[setting(default = VALUE)]")),
        });
    }
    let name = &input.ident;
    Ok(quote! {
        impl ::core::default::Default for #name {
            fn default() -> Self {
                Self { #(#defaults),* }
            }
        }

        impl ::cairn_settings::Settings for #name {
            fn list(&self, path: &str, out: &mut ::std::vec::Vec<::cairn_settings::Item>) {
                #(#entries)*
                #(#sections)*
            }
        }
    })
}

/// The attribute of one field.
fn field_attribute(field: &Field) -> syn::Result<FieldAttribute> {
    let mut told = FieldAttribute::default();
    for attribute in field.attrs.iter().filter(|a| a.path().is_ident("setting")) {
        attribute.parse_nested_meta(|meta| {
            match meta.path.get_ident().map(ToString::to_string).as_deref() {
                Some("section") => told.section = true,
                Some("flatten") => told.flatten = true,
                Some("skip") => told.skip = true,
                Some("default") => told.default = Some(until_comma(meta.value()?)?),
                Some("range") => {
                    let value = meta.value()?;
                    let low = until(value, |v| v.peek(Token![..=]))?;
                    value.parse::<Token![..=]>()?;
                    told.range = Some((low, until_comma(value)?));
                }
                _ => return Err(meta.error("known are: default, range, section, flatten, skip")),
            }
            Ok(())
        })?;
    }
    Ok(told)
}

fn until_comma(input: ParseStream<'_>) -> syn::Result<TokenStream> {
    until(input, |v| v.peek(Token![,]))
}

/// The tokens up to those at which `end` says so, or all.
fn until(input: ParseStream<'_>, end: impl Fn(ParseStream<'_>) -> bool) -> syn::Result<TokenStream> {
    let mut tokens = TokenStream::new();
    while !input.is_empty() && !end(input) {
        tokens.extend([input.parse::<TokenTree>()?]);
    }
    if tokens.is_empty() { Err(input.error("a value is missing")) } else { Ok(tokens) }
}

/// The doc comment as one line.
fn help(attributes: &[Attribute]) -> syn::Result<String> {
    let mut words = Vec::new();
    for attribute in attributes.iter().filter(|a| a.path().is_ident("doc")) {
        if let Meta::NameValue(pair) = &attribute.meta
            && let Expr::Lit(ExprLit { lit: Lit::Str(text), .. }) = &pair.value
        {
            words.extend(text.value().split_whitespace().map(str::to_owned));
        }
    }
    Ok(words.join(" "))
}
