//! `cairn page`.

use crate::binary::{cairn, folder, json, stderr};

#[test]
fn page_is_written_with_a_module_and_says_how_to_build_one() {
    let folder = folder("page");
    let (site, module) = (folder.join("site"), folder.join("cairn.wasm"));
    let (out, file) = (site.display().to_string(), module.display().to_string());
    let without = cairn(&["page", "--out", &out]);
    assert_eq!(without.status.code(), Some(2), "{}", stderr(&without));
    assert!(stderr(&without).contains("tools/build_wasm"), "{}", stderr(&without));
    std::fs::write(&module, "no module").unwrap();
    let wrong = cairn(&["page", "--out", &out, "--module", &file]);
    assert_eq!(wrong.status.code(), Some(1), "{}", stderr(&wrong));
    assert!(
        stderr(&wrong).contains("no WebAssembly module of Cairn") && !site.exists(),
        "{}",
        stderr(&wrong)
    );
    std::fs::write(&module, b"\0asm\x01\0\0\0cairn_apply").unwrap();
    let written = json(&cairn(&["page", "--out", &out, "--module", &file, "--json"]));
    assert!(written["files"].as_u64() > Some(30), "{written}");
    for name in ["index.html", "service.js", "words/de.json", "cairn.wasm"] {
        assert!(site.join(name).is_file(), "{name}");
    }
}
