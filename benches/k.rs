//! The kinematics of the crate `k`, used the cheapest way that its interface has.

use k::nalgebra::DMatrix;
use k::{Chain, Isometry3, Node, SerialChain};

use crate::PANDA;

/// The Panda as `k` has it.
pub struct Panda(SerialChain<f64>);

impl Panda {
    /// From the same file as ours.
    ///
    /// # Panics
    /// If that is not what it was.
    #[expect(clippy::new_without_default, reason = "there is nothing to default to")]
    pub fn new() -> Self {
        let robot = urdf_rs::read_from_string(PANDA).expect("it is a robot");
        let chain = Chain::<f64>::from(robot);
        Panda(SerialChain::from_end(
            chain.find("flange").expect("it has a flange"),
        ))
    }

    /// The tip's pose.
    pub fn forward(&self, q: &[f64; 7]) -> Isometry3<f64> {
        self.0.set_joint_positions_unchecked(q);
        self.0.end_transform()
    }

    /// The Jacobian, which brings the frames' poses with it; the tip's is the last.
    pub fn forward_and_jacobian(&self, q: &[f64; 7]) -> (DMatrix<f64>, Option<Isometry3<f64>>) {
        self.0.set_joint_positions_unchecked(q);
        let jacobian = k::jacobian(&self.0);
        (
            jacobian,
            self.0.iter().last().and_then(Node::world_transform),
        )
    }
}
