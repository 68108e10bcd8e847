//! A synergy for each reach: the core's map, and the stepper that it was learned with.

use sinew::Error;
use sinew::map::{Reach, SynergyMap};
use sinew::stepper::AnyStepper;
use sinew::synergy::Model;
use sinew_protocol::DOFS;

use crate::arm::Style;

/// Plans how the arm moves to a target.
#[derive(Clone, Debug)]
pub struct Planner {
    /// The stepper.
    pub stepper: AnyStepper<f32>,
    /// Its rate λ.
    pub rate: f32,
    /// The map's model.
    pub model: Model,
    /// The map.
    pub map: SynergyMap<f32, DOFS>,
}

impl Planner {
    /// How to move to `target`, metres in the base frame, in about `seconds`; and how far to trust that, from 0 to 1.
    ///
    /// # Errors
    /// A number that is not finite, or a time that is not above 0.
    // Inlined into the main loop it takes a kilobyte more of the flash.
    #[inline(never)]
    pub fn plan(&self, target: [f32; 3], seconds: f32) -> Result<(Style, f32), Error> {
        let planned = self.map.plan(&Reach { target, seconds })?;
        let style = Style::new(
            self.stepper,
            self.rate,
            &planned.synergy,
            self.model,
            &planned.parameters,
        )?;
        Ok((style, planned.confidence))
    }
}
