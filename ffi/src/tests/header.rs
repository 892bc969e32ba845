//! `ffi/include/mrvis.h` against `src`: names, types, constants, sizes, offsets, versions, exported symbols.

use std::collections::{BTreeMap, BTreeSet};
use std::fs;
use std::path::{Path, PathBuf};

/// A folder or file of this package.
fn project(path: &str) -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join(path)
}

/// What one side says: functions with their types, records with their members, constants.
#[derive(Default)]
struct Side {
    functions: BTreeMap<String, String>,
    records: BTreeMap<String, Vec<(String, String)>>,
    constants: BTreeMap<String, i128>,
    /// Asserted by bindgen: sizes, and offsets of members.
    sizes: BTreeMap<String, usize>,
    offsets: BTreeMap<(String, String), usize>,
}

/// Syntax as text that is the same on both sides.
fn shown(syntax: &impl quote::ToTokens) -> String {
    let text = syntax.to_token_stream().to_string().replace(' ', "");
    let text = text.replace("::std::os::raw::", "").replace("::std::option::", "");
    text.replace("usize]", "]").replace(",)", ")").replace(",>", ">")
}

/// What the macro `in_c` makes of an argument of an entry.
fn in_c(kind: &str) -> String {
    let inner = |kind: &str| kind.strip_suffix('>').expect("a type").to_owned();
    match kind.split_once('<') {
        Some(("Handle" | "Record" | "Given" | "Pointer", of)) => format!("*const{}", inner(of)),
        Some(("Made", of)) => format!("*mut*mut{}", inner(of)),
        Some((_, of)) => format!("*mut{}", inner(of)),
        _ if kind.ends_with("Text") => "*constc_char".into(),
        _ => kind.into(),
    }
}

impl Side {
    fn add(&mut self, source: &str, exported_only: bool) {
        let file = syn::parse_file(source).expect("Rust");
        let signature = |inputs: &syn::punctuated::Punctuated<syn::FnArg, syn::Token![,]>,
                         output: &syn::ReturnType| {
            let inputs = inputs.iter().map(|input| match input {
                syn::FnArg::Typed(input) => shown(&input.ty),
                syn::FnArg::Receiver(_) => panic!("a method"),
            });
            let output = match output {
                syn::ReturnType::Default => "()".to_owned(),
                syn::ReturnType::Type(_, output) => shown(output),
            };
            format!("({}) -> {output}", inputs.collect::<Vec<_>>().join(", "))
        };
        for item in &file.items {
            match item {
                syn::Item::ForeignMod(foreign) => {
                    for item in &foreign.items {
                        let syn::ForeignItem::Fn(function) = item else { continue };
                        let sig = &function.sig;
                        self.functions.insert(sig.ident.to_string(), signature(&sig.inputs, &sig.output));
                    }
                }
                syn::Item::Fn(function) if exported_only && function.sig.abi.is_some() => {
                    let sig = &function.sig;
                    self.functions.insert(sig.ident.to_string(), signature(&sig.inputs, &sig.output));
                }
                syn::Item::Struct(record) if record.ident.to_string().starts_with("mrv_") => {
                    self.add_record(record)
                }
                syn::Item::Macro(item) if item.mac.path.is_ident("record") => {
                    // Behind the size of the first version and a colon.
                    let tokens = item.mac.tokens.clone().into_iter().skip(2).collect();
                    let record: syn::ItemStruct = syn::parse2(tokens).expect("a record");
                    // Those of tests have other names.
                    if record.ident.to_string().starts_with("mrv_") {
                        self.add_record(&record);
                    }
                }
                syn::Item::Macro(item) if item.mac.path.is_ident("handle") => {
                    let text = shown(&item.mac.tokens);
                    let name = text.split('(').next().expect("a name");
                    let mut functions = text.rsplit(',');
                    for output in ["()", "mrv_status"] {
                        let function = functions.next().expect("a function");
                        self.functions.insert(function.into(), format!("(*const{name}) -> {output}"));
                    }
                }
                syn::Item::Macro(item) if item.mac.path.is_ident("entry") => {
                    let text = shown(&item.mac.tokens);
                    let (name, rest) = text.split_once("(call").expect("a name");
                    let head = rest.split('{').next().expect("arguments").replace(")->", ",");
                    let arguments = head.trim_end_matches(')').split(',').skip(1);
                    let types: Vec<String> =
                        arguments.map(|argument| in_c(argument.split_once(':').expect("a type").1)).collect();
                    self.functions.insert(name.into(), format!("({}) -> mrv_status", types.join(", ")));
                }
                syn::Item::Const(constant) if constant.ident.to_string().starts_with("MRV_") => {
                    let value = shown(&constant.expr);
                    let value = if value == "usize::MAX" { Ok(i128::from(u64::MAX)) } else { value.parse() };
                    self.constants.insert(constant.ident.to_string(), value.expect("a number"));
                }
                syn::Item::Type(alias) if alias.ident == "mrv_progress" => {
                    self.functions.insert(alias.ident.to_string(), shown(&alias.ty));
                }
                _ => {}
            }
        }
    }

    fn add_record(&mut self, record: &syn::ItemStruct) {
        let member =
            |field: &syn::Field| (field.ident.as_ref().expect("a name").to_string(), shown(&field.ty));
        let mut members: Vec<_> = record.fields.iter().map(member).collect();
        members.retain(|(name, _)| !name.starts_with('_'));
        if !members.is_empty() {
            self.records.insert(record.ident.to_string(), members);
        }
    }

    /// The assertions `["Size of …"][size_of::<…>() - 24usize]` of bindgen.
    fn add_assertions(&mut self, text: &str) {
        for part in text.split("[\"").skip(1) {
            let (Some(what), Some(number)) = (part.split('"').next(), part.split(" - ").nth(1)) else {
                continue;
            };
            let digits: String = number.trim().chars().take_while(char::is_ascii_digit).collect();
            let Ok(number) = digits.parse() else { continue };
            if let Some(name) = what.strip_prefix("Size of ") {
                self.sizes.insert(name.into(), number);
            } else if let Some((record, member)) =
                what.strip_prefix("Offset of field: ").and_then(|f| f.split_once("::"))
            {
                self.offsets.insert((record.into(), member.into()), number);
            }
        }
    }
}

/// The header, as bindgen reads it.
fn header_side() -> Side {
    let text = bindgen::Builder::default()
        .header(project("include/mrvis.h").display().to_string())
        .allowlist_item("mrv_.*|MRV_.*")
        .default_macro_constant_type(bindgen::MacroTypeVariation::Signed)
        .layout_tests(true)
        .generate()
        .expect("bindings")
        .to_string();
    let mut side = Side::default();
    side.add(&text, false);
    side.add_assertions(&text);
    side
}

/// The exported functions and records of `src`.
fn library_side() -> Side {
    let mut side = Side::default();
    for entry in fs::read_dir(project("src")).expect("a room") {
        let path = entry.expect("an entry").path();
        if path.extension().is_some_and(|e| e == "rs") {
            side.add(&fs::read_to_string(path).expect("a file"), true);
        }
    }
    side
}

/// Compares what both sides say, so that a failure shows the differences alone.
fn assert_same<T: PartialEq + std::fmt::Debug>(
    what: &str,
    header: &BTreeMap<String, T>,
    library: &BTreeMap<String, T>,
) {
    let names: BTreeSet<&String> = header.keys().chain(library.keys()).collect();
    let differ = names.into_iter().filter(|name| header.get(*name) != library.get(*name));
    let differ: Vec<_> = differ.map(|name| (name, header.get(name), library.get(name))).collect();
    assert!(differ.is_empty(), "{what} (name, header, src): {differ:#?}");
}

#[test]
fn the_header_declares_what_the_library_exports() {
    let (header, library) = (header_side(), library_side());
    assert!(header.functions.len() > 40 && header.records.len() > 15, "bindgen found little");
    assert_same("functions", &header.functions, &library.functions);
    assert_same("records", &header.records, &library.records);
    let mut constants = header.constants;
    constants.retain(|name, _| !name.starts_with("MRV_VERSION"));
    // bindgen does not give the value of SIZE_MAX.
    constants.insert("MRV_SAME_POSITION".into(), i128::from(u64::MAX));
    assert_same("constants", &constants, &library.constants);
}

/// A member that is appended later must not fit into padding, or its absence could not be seen. Records with the members of the header have
/// its sizes and offsets: they are `repr(C)`.
#[test]
fn no_record_ends_with_padding() {
    let header = header_side();
    for (name, members) in header.records.iter().filter(|(_, members)| members[0].0 == "struct_size") {
        let (last, kind) = members.last().expect("a member");
        let width = match kind.as_str() {
            "u8" => 1,
            "i32" | "u32" | "f32" => 4,
            "[f64;3]" => 24,
            _ => 8,
        };
        let end = header.offsets[&(name.clone(), last.clone())] + width;
        assert_eq!(end, header.sizes[name], "{name} ends with padding after `{last}`");
    }
}

#[test]
fn versions_agree() {
    let header = header_side();
    let of = |name: &str| header.constants.get(&format!("MRV_VERSION_{name}")).copied();
    let number = |text: &str| Some(text.parse::<i128>().expect("a number"));
    assert_eq!(of("MAJOR"), number(env!("CARGO_PKG_VERSION_MAJOR")));
    assert_eq!(of("MINOR"), number(env!("CARGO_PKG_VERSION_MINOR")));
    assert_eq!(of("PATCH"), number(env!("CARGO_PKG_VERSION_PATCH")));
    // The program `answers.c` compares MRV_VERSION with mrv_version() at run time.
}

/// Every exported function has one guard around its body, and no profile turns panics into the end of the host.
#[test]
fn every_function_is_guarded() {
    for entry in fs::read_dir(project("src")).expect("a room") {
        let path = entry.expect("an entry").path();
        // `handle!` and `entry!` write functions with their guards.
        let writers = ["guard.rs", "handle.rs", "entry.rs"];
        if path.is_dir() || path.file_name().is_some_and(|name| writers.iter().any(|writer| name == *writer))
        {
            continue;
        }
        let text = fs::read_to_string(&path).expect("a file");
        let exported = text.matches("#[unsafe(no_mangle)]").count();
        let guards = text.matches(" guard(\"mrv_").count() + text.matches(" or_if_panics(").count();
        assert_eq!(exported, guards, "{}: functions and guards", path.display());
        for part in text.split("#[unsafe(no_mangle)]").skip(1) {
            let name = part.split("fn ").nth(1).and_then(|rest| rest.split('(').next()).expect("a name");
            let returns_value = part.contains(" or_if_panics(");
            assert!(
                returns_value || part.contains(&format!("guard(\"{name}\"")),
                "{name}: its guard has another name"
            );
        }
    }
    let manifest = fs::read_to_string(project("../Cargo.toml")).expect("the manifest");
    assert!(!manifest.contains("panic ="), "the guards need unwinding");
}
