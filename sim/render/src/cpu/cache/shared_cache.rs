//! Cache of values derived from static geometry, shared by every scene whose static geometry is identical.

use std::sync::{Arc, Mutex, PoisonError, Weak};

/// A cache keyed by content. It holds weak references: an entry lives as long as at least one scene uses it.
pub(crate) struct SharedCache<K, V>(Mutex<Vec<(K, Weak<V>)>>);

impl<K: PartialEq, V> SharedCache<K, V> {
    /// Creates an empty cache.
    pub(crate) const fn new() -> Self {
        Self(Mutex::new(Vec::new()))
    }

    /// Returns the cached value for `key`, computing it with `compute` on a miss.
    pub(crate) fn get_or_insert_with(&self, key: K, compute: impl FnOnce() -> V) -> Arc<V> {
        let cached = Self::find(&self.0.lock().unwrap_or_else(PoisonError::into_inner), &key);
        if let Some(cached) = cached {
            return cached;
        }
        // Compute outside the lock so that other threads are not blocked. If two threads race, the first
        // insert wins.
        let value = Arc::new(compute());
        let mut entries = self.0.lock().unwrap_or_else(PoisonError::into_inner);
        if let Some(cached) = Self::find(&entries, &key) {
            return cached;
        }
        entries.retain(|(_, value)| value.strong_count() > 0);
        entries.push((key, Arc::downgrade(&value)));
        value
    }

    fn find(entries: &[(K, Weak<V>)], key: &K) -> Option<Arc<V>> {
        entries.iter().filter(|(entry_key, _)| entry_key == key).find_map(|(_, value)| value.upgrade())
    }
}

#[cfg(test)]
mod tests {
    use std::sync::Arc;

    use super::SharedCache;

    #[test]
    fn values_are_shared_and_dropped_with_last_user() {
        let cache = SharedCache::new();
        let first = cache.get_or_insert_with("a", || 1);
        assert!(Arc::ptr_eq(&first, &cache.get_or_insert_with("a", || unreachable!())));
        assert_eq!(*cache.get_or_insert_with("b", || 2), 2);
        // The value was dropped right after the previous line.
        assert_eq!(*cache.get_or_insert_with("b", || 3), 3);
        drop(first);
        assert_eq!(*cache.get_or_insert_with("a", || 4), 4);
    }

    #[test]
    fn first_insert_wins_when_computations_overlap() {
        let cache = SharedCache::new();
        let mut inner = None;
        let outer = cache.get_or_insert_with("a", || {
            inner = Some(cache.get_or_insert_with("a", || 1));
            2
        });
        assert!(Arc::ptr_eq(&outer, &inner.unwrap()));
        assert_eq!(*outer, 1);
    }
}
