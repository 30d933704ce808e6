//! A slot for data that a renderer derives from a scene, which the scene owns without knowing its type.

use std::any::Any;
use std::sync::OnceLock;

/// Renderer-specific data of a scene, created on first use and dropped with the scene.
#[derive(Default)]
pub(crate) struct Attachment(OnceLock<Box<dyn Any + Send + Sync>>);

impl Attachment {
    /// Returns the attached data, creating it with `init` on first use.
    ///
    /// # Panics
    /// If data of another type is attached: a scene has room for one kind of renderer.
    pub(crate) fn get_or_init<T: Any + Send + Sync>(&self, init: impl FnOnce() -> T) -> &T {
        let data = self.0.get_or_init(|| Box::new(init()));
        data.downcast_ref().expect("data of a single kind of renderer")
    }
}
