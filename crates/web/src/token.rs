//! Secret names: the access token, and what else nobody may guess.

use crate::certificate::write_private;
use crate::error::WebError;
use std::path::Path;

/// The file of the access token in the data folder.
const FILE: &str = "key";

/// Bytes that nobody can foresee.
pub(crate) fn random<const N: usize>() -> Result<[u8; N], WebError> {
    let mut bytes = [0; N];
    rustls::crypto::ring::default_provider()
        .secure_random
        .fill(&mut bytes)
        .map_err(|_| WebError::machine("this machine provides no random numbers"))?;
    Ok(bytes)
}

/// A random token of 128 bits.
pub(crate) fn new_token() -> Result<String, WebError> {
    Ok(random::<16>()?.iter().map(|b| format!("{b:02x}")).collect())
}

/// The access token of a data folder, so that a bookmark stays good; a new one where there is none, or `anew`. Also returns why
/// it could not be stored, if so.
pub(crate) fn kept_token(folder: &Path, anew: bool) -> Result<(String, Option<String>), WebError> {
    let path = folder.join(FILE);
    let kept = std::fs::read_to_string(&path).unwrap_or_default().trim().to_owned();
    let is_token = kept.len() == 32 && kept.bytes().all(|b| b.is_ascii_hexdigit());
    if is_token && !anew {
        return Ok((kept, None));
    }
    let new = new_token()?;
    let written = std::fs::create_dir_all(folder).and_then(|()| write_private(&path, &new));
    Ok((new, written.err().map(|e| format!("{}: {e}", path.display()))))
}

/// Compares two tokens in constant time.
pub(crate) fn same(a: &str, b: &str) -> bool {
    a.len() == b.len() && a.bytes().zip(b.bytes()).fold(0, |d, (x, y)| d | (x ^ y)) == 0
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn tokens_differ() {
        let (a, b) = (new_token().unwrap(), new_token().unwrap());
        assert!(a != b && a.len() == 32);
        assert!(same(&a, &a) && !same(&a, &b) && !same(&a, &a[1..]));
    }

    #[test]
    fn a_folder_keeps_its_token_until_another_is_asked_for() {
        let folder = std::env::temp_dir().join(format!("cairn-key-{}", std::process::id()));
        let _ = std::fs::remove_dir_all(&folder);
        let kept = |anew| kept_token(&folder, anew).unwrap().0;
        let first = kept(false);
        assert_eq!(kept(false), first);
        let second = kept(true);
        assert!(second != first && kept(false) == second);
        // A damaged file is no token.
        std::fs::write(folder.join(FILE), &second[1..]).unwrap();
        assert_eq!(kept(false).len(), 32);
        #[cfg(unix)]
        {
            let mode = std::fs::metadata(folder.join(FILE)).unwrap();
            assert_eq!(std::os::unix::fs::PermissionsExt::mode(&mode.permissions()) & 0o077, 0);
        }
        std::fs::remove_dir_all(&folder).unwrap();
        std::fs::write(&folder, "a file, not a folder").unwrap();
        assert!(kept_token(&folder, false).unwrap().1.unwrap().contains("key"));
        std::fs::remove_file(&folder).unwrap();
    }
}
