//! Mass properties of bodies.

use nalgebra::Vector3;

/// Mass properties of a body.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Mass {
    /// Every collision shape has this density, in kg/m³.
    Density(f64),
    /// Measured on the original's body at scale 1, for bodies whose collision shapes overlap or only
    /// approximate the original's.
    Measured {
        /// Mass in kg.
        kg: f64,
        /// Centre of mass in the body's frame, in m.
        centre: [f64; 3],
        /// Moments of inertia about the axes of the body's frame through the centre of mass, in kg·m².
        inertia: [f64; 3],
    },
}

impl Mass {
    /// Returns the mass properties after stretching the body by a factor along each axis at constant density.
    #[must_use]
    pub fn stretched(self, factors: &Vector3<f64>) -> Self {
        match self {
            Self::Density(_) => self,
            Self::Measured { kg, centre, inertia } => {
                let volume = factors.product();
                // The second moment of mass along an axis is half the sum of the other two moments of inertia
                // minus its own; it scales with the square of the length along the axis.
                let half_sum = inertia.iter().sum::<f64>() / 2.0;
                let along: [f64; 3] = core::array::from_fn(|axis| {
                    (half_sum - inertia[axis]).max(0.0) * factors[axis] * factors[axis] * volume
                });
                let total: f64 = along.iter().sum();
                Self::Measured {
                    kg: kg * volume,
                    centre: core::array::from_fn(|axis| centre[axis] * factors[axis]),
                    inertia: along.map(|moment| total - moment),
                }
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn stretched_box_has_inertia_of_larger_box() {
        let of_box = |half: [f64; 3], kg: f64| {
            let square = half.map(|h| h * h);
            let total: f64 = square.iter().sum();
            let inertia = square.map(|s| kg / 3.0 * (total - s));
            Mass::Measured { kg, centre: half, inertia }
        };
        let factors = Vector3::new(0.8, 1.1, 1.2);
        let stretched = of_box([0.1, 0.2, 0.3], 2.0).stretched(&factors);
        let expected = of_box([0.08, 0.22, 0.36], 2.0 * factors.product());
        let (
            Mass::Measured { kg, centre, inertia },
            Mass::Measured { kg: kg2, centre: centre2, inertia: inertia2 },
        ) = (stretched, expected)
        else {
            panic!("both are measured")
        };
        assert!((kg - kg2).abs() < 1e-12);
        for axis in 0..3 {
            assert!((centre[axis] - centre2[axis]).abs() < 1e-12);
            assert!((inertia[axis] - inertia2[axis]).abs() < 1e-12);
        }
    }
}
