//! What is kept of what stands still: once for all scenes in which it is alike.

use std::sync::{Arc, Mutex, PoisonError, Weak};

/// Things that scenes keep, known by what they are made of; forgotten with the last scene that keeps them.
pub(in crate::render::cpu) struct SharedCache<K, T>(Mutex<Vec<(K, Weak<T>)>>);

impl<K: PartialEq, T> SharedCache<K, T> {
    /// Nothing yet.
    pub(in crate::render::cpu) const fn new() -> Self {
        Self(Mutex::new(Vec::new()))
    }

    /// What is made of this, unless there is such a thing.
    pub(in crate::render::cpu) fn get(&self, of: K, make: impl FnOnce() -> T) -> Arc<T> {
        let known = Self::find(&self.0.lock().unwrap_or_else(PoisonError::into_inner), &of);
        if let Some(known) = known {
            return known;
        }
        // Others need not wait for it. If one of them makes the same, the first to be ready is kept.
        let made = Arc::new(make());
        let mut all = self.0.lock().unwrap_or_else(PoisonError::into_inner);
        if let Some(known) = Self::find(&all, &of) {
            return known;
        }
        all.retain(|(_, thing)| thing.strong_count() > 0);
        all.push((of, Arc::downgrade(&made)));
        made
    }

    fn find(all: &[(K, Weak<T>)], of: &K) -> Option<Arc<T>> {
        all.iter().filter(|(known, _)| known == of).find_map(|(_, thing)| thing.upgrade())
    }
}

#[cfg(test)]
mod tests {
    use std::sync::Arc;

    use super::SharedCache;

    #[test]
    fn alike_things_are_made_once_and_forgotten_with_the_last_that_has_them() {
        let kept = SharedCache::new();
        let first = kept.get("a", || 1);
        assert!(Arc::ptr_eq(&first, &kept.get("a", || unreachable!())));
        assert_eq!(*kept.get("b", || 2), 2);
        // Nobody has kept it.
        assert_eq!(*kept.get("b", || 3), 3);
        drop(first);
        assert_eq!(*kept.get("a", || 4), 4);
    }

    #[test]
    fn of_two_that_are_made_at_a_time_one_is_kept() {
        let kept = SharedCache::new();
        let mut inner = None;
        let outer = kept.get("a", || {
            inner = Some(kept.get("a", || 1));
            2
        });
        assert!(Arc::ptr_eq(&outer, &inner.unwrap()));
        assert_eq!(*outer, 1);
    }
}
