//! Policies: networks, one folder per family, and the policies without weights.
//!
//! Adding a family takes one folder here that defines `FAMILY`, and one line in the list below.

pub mod act;
pub mod family;
pub mod idle;
pub mod pi05;
pub mod random;
pub mod robot_state;
pub mod synthetic;

#[cfg(feature = "gpu")]
mod gpu;
mod rows;

use serde::{Deserialize, Serialize};

use self::family::NetworkFamily;
#[cfg(feature = "gpu")]
pub use self::gpu::{DeviceNetwork, GpuPolicy, LoadGpuError};

macro_rules! family_list {
    ($($module:ident => $name:ident,)+) => {
        /// A family of networks.
        #[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
        #[expect(missing_docs, reason = "each family's module describes it")]
        pub enum Family { $($name,)+ }

        impl Family {
            /// All families, in the order in which help texts list them.
            pub const ALL: &[Self] = &[$(Self::$name,)+];

            /// Returns the definition of the family.
            #[must_use]
            pub const fn definition(self) -> &'static NetworkFamily {
                match self { $(Self::$name => &$module::FAMILY,)+ }
            }
        }
    };
}

family_list! {
    act => Act,
    pi05 => Pi05,
}
