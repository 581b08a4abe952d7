//! A persistent array: three levels of 64-way nodes, shared between versions until they are written.
//!
//! A clone copies one short vector of pointers; a write copies at most one node of each level. Nodes that
//! have become empty are freed, so memory follows what exists now, not what ever existed.

use std::sync::Arc;

const WIDTH: usize = 64;

#[derive(Clone)]
struct Node<C> {
    slots: [Option<Arc<C>>; WIDTH],
    used: usize,
}

impl<C> Default for Node<C> {
    fn default() -> Self {
        Self { slots: [const { None }; WIDTH], used: 0 }
    }
}

/// Values by index.
#[derive(Debug)]
pub(crate) struct Arena<T> {
    roots: Vec<Option<Arc<Node<Node<T>>>>>,
    len: usize,
}

impl<T> std::fmt::Debug for Node<T> {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        write!(f, "Node({} used)", self.used)
    }
}

impl<T> Clone for Arena<T> {
    fn clone(&self) -> Self {
        Self { roots: self.roots.clone(), len: self.len }
    }
}

impl<T> Default for Arena<T> {
    fn default() -> Self {
        Self { roots: Vec::new(), len: 0 }
    }
}

impl<T: Clone> Arena<T> {
    /// How many values there are.
    pub fn len(&self) -> usize {
        self.len
    }

    /// The value at an index.
    #[inline]
    pub fn get(&self, index: usize) -> Option<&T> {
        let (r, n, s) = split(index);
        self.roots.get(r)?.as_ref()?.slots[n].as_ref()?.slots[s].as_deref()
    }

    /// The value at an index, to change; copies it if another version shares it.
    pub fn get_mut(&mut self, index: usize) -> Option<&mut T> {
        let (r, n, s) = split(index);
        let root = Arc::make_mut(self.roots.get_mut(r)?.as_mut()?);
        let leaf = Arc::make_mut(root.slots[n].as_mut()?);
        leaf.slots[s].as_mut().map(Arc::make_mut)
    }

    /// Puts a value at an index, replacing what was there.
    pub fn insert(&mut self, index: usize, value: T) {
        let (r, n, s) = split(index);
        if self.roots.len() <= r {
            self.roots.resize_with(r + 1, || None);
        }
        let root = Arc::make_mut(self.roots[r].get_or_insert_default());
        root.used += root.slots[n].is_none() as usize;
        let leaf = Arc::make_mut(root.slots[n].get_or_insert_default());
        if leaf.slots[s].replace(Arc::new(value)).is_none() {
            leaf.used += 1;
            self.len += 1;
        }
    }

    /// Removes a value; true when there was one.
    pub fn remove(&mut self, index: usize) -> bool {
        if self.get(index).is_none() {
            return false;
        }
        let (r, n, s) = split(index);
        let Some(root_slot) = self.roots.get_mut(r) else { return false };
        let Some(root) = root_slot.as_mut().map(Arc::make_mut) else { return false };
        let Some(leaf) = root.slots[n].as_mut().map(Arc::make_mut) else { return false };
        leaf.slots[s] = None;
        leaf.used -= 1;
        self.len -= 1;
        if leaf.used == 0 {
            root.slots[n] = None;
            root.used -= 1;
        }
        if root.used == 0 {
            *root_slot = None;
        }
        true
    }

    /// All values with their indices, in order.
    pub fn iter(&self) -> impl Iterator<Item = (usize, &T)> {
        self.roots.iter().enumerate().flat_map(|(r, root)| {
            root.iter().flat_map(move |root| {
                root.slots.iter().enumerate().flat_map(move |(n, leaf)| {
                    leaf.iter().flat_map(move |leaf| {
                        leaf.slots.iter().enumerate().filter_map(move |(s, value)| {
                            value.as_deref().map(|value| ((r * WIDTH + n) * WIDTH + s, value))
                        })
                    })
                })
            })
        })
    }
}

fn split(index: usize) -> (usize, usize, usize) {
    (index / (WIDTH * WIDTH), index / WIDTH % WIDTH, index % WIDTH)
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;
    use std::collections::BTreeMap;

    proptest! {
        /// Any history of writes gives the same as an ordered map, and old versions stay as they were.
        #[test]
        fn behaves_as_an_ordered_map(history in prop::collection::vec((0usize..9000, 0u8..3, any::<u16>()), 1..200)) {
            let (mut arena, mut model) = (Arena::default(), BTreeMap::new());
            let mut versions = Vec::new();
            for (index, action, value) in history {
                match action {
                    0 => {
                        arena.insert(index, value);
                        model.insert(index, value);
                    }
                    1 => {
                        prop_assert_eq!(arena.remove(index), model.remove(&index).is_some());
                    }
                    _ => {
                        if let Some(v) = arena.get_mut(index) {
                            *v = value;
                        }
                        model.entry(index).and_modify(|v| *v = value);
                    }
                }
                versions.push((arena.clone(), model.clone()));
            }
            for (arena, model) in versions {
                prop_assert_eq!(arena.len(), model.len());
                let all: Vec<(usize, u16)> = arena.iter().map(|(i, v)| (i, *v)).collect();
                prop_assert_eq!(all, model.into_iter().collect::<Vec<_>>());
            }
        }
    }
}
