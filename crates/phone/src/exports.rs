//! What a page calls. It asks for room for a message's content, writes it there, and calls `cairn_apply` with the kind; the answer, JSON,
//! lies at `cairn_answer`, as long as `cairn_apply` said.
#![expect(unsafe_code, reason = "names that a page can find; no pointer is followed here")]

use crate::message::apply;
use crate::phone::Phone;
use std::cell::RefCell;

thread_local! {
    static STATE: RefCell<State> = RefCell::default();
}

#[derive(Default)]
struct State {
    phone: Option<Phone>,
    content: Vec<u8>,
    answer: Vec<u8>,
    map: Vec<u8>,
}

/// Room for so many bytes of the next message.
#[unsafe(no_mangle)]
pub extern "C" fn cairn_content(bytes: usize) -> *mut u8 {
    STATE.with_borrow_mut(|state| {
        state.content.resize(bytes, 0);
        state.content.as_mut_ptr()
    })
}

/// Carries out the message whose content was written; the length of the answer.
#[unsafe(no_mangle)]
pub extern "C" fn cairn_apply(kind: u8) -> usize {
    STATE.with_borrow_mut(|state| {
        let mut answer = apply(&mut state.phone, kind, &state.content);
        state.map = std::mem::take(&mut answer.map);
        state.answer.clear();
        // Writing numbers and words to memory does not fail.
        let _ = serde_json::to_writer(&mut state.answer, &answer);
        state.answer.len()
    })
}

/// The answer to the last message.
#[unsafe(no_mangle)]
pub extern "C" fn cairn_answer() -> *const u8 {
    STATE.with_borrow(|state| state.answer.as_ptr())
}

/// The map that the last message asked for, as long as `cairn_map_length` says.
#[unsafe(no_mangle)]
pub extern "C" fn cairn_map() -> *const u8 {
    STATE.with_borrow(|state| state.map.as_ptr())
}

/// Bytes of the map.
#[unsafe(no_mangle)]
pub extern "C" fn cairn_map_length() -> usize {
    STATE.with_borrow(|state| state.map.len())
}

/// The standard library names this, older C libraries lack it; a page has no threads.
#[unsafe(no_mangle)]
extern "C" fn pthread_join(_thread: usize, _result: usize) -> i32 {
    NOT_SUPPORTED
}

/// As `pthread_join`.
#[unsafe(no_mangle)]
extern "C" fn pthread_detach(_thread: usize) -> i32 {
    NOT_SUPPORTED
}

/// `ENOTSUP` of WASI.
const NOT_SUPPORTED: i32 = 58;
