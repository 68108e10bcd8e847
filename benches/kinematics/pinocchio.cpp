// Pinocchio's kinematics of one arm behind a C interface, for beside.rs to load. Every function takes `count` joint
// vectors side by side, so that the way here costs nothing.
#include <pinocchio/algorithm/frames.hpp>
#include <pinocchio/algorithm/jacobian.hpp>
#include <pinocchio/algorithm/kinematics.hpp>

namespace {
using Jacobian = Eigen::Matrix<double, 6, 7>;
using Posture = Eigen::Matrix<double, 7, 1>;

pinocchio::Model model;
pinocchio::Data data;
pinocchio::FrameIndex tip;
Jacobian jacobian;

// Stops the compiler from leaving out what nobody reads.
void keep() { asm volatile("" : : "g"(&data), "g"(&jacobian) : "memory"); }

template <typename Work>
void each(const double *q, size_t count, Work work) {
    for (size_t i = 0; i < count; i++) {
        work(Eigen::Map<const Posture>(q + 7 * i));
        keep();
    }
}
}  // namespace

extern "C" {
// `placements`: for each of the 7 joints about z and for the tip, where its frame lies in the frame before: a
// translation and a unit quaternion x, y, z, w. The model is what Pinocchio's URDF reader makes of such an arm.
void open_arm(const double *placements) {
    model = pinocchio::Model();
    auto placement = [&](int i) {
        const double *p = placements + 7 * i;
        return pinocchio::SE3(Eigen::Quaterniond(p[6], p[3], p[4], p[5]), Eigen::Vector3d(p[0], p[1], p[2]));
    };
    pinocchio::JointIndex joint = 0;
    for (int i = 0; i < 7; i++)
        joint = model.addJoint(joint, pinocchio::JointModelRZ(), placement(i), "joint" + std::to_string(i + 1));
    tip = model.addFrame(pinocchio::Frame("flange", joint, placement(7), pinocchio::OP_FRAME));
    data = pinocchio::Data(model);
    jacobian.setZero();
}

void forward(const double *q, size_t count) {
    each(q, count, [](const auto &q) {
        pinocchio::forwardKinematics(model, data, q);
        pinocchio::updateFramePlacement(model, data, tip);
    });
}

// By all of the joints' Jacobians, which come with forward kinematics.
void forward_and_jacobian(const double *q, size_t count) {
    each(q, count, [](const auto &q) {
        pinocchio::computeJointJacobians(model, data, q);
        pinocchio::getFrameJacobian(model, data, tip, pinocchio::LOCAL_WORLD_ALIGNED, jacobian);
        pinocchio::updateFramePlacement(model, data, tip);
    });
}

// By the one frame's Jacobian.
void forward_and_frame_jacobian(const double *q, size_t count) {
    each(q, count, [](const auto &q) {
        pinocchio::computeFrameJacobian(model, data, q, tip, pinocchio::LOCAL_WORLD_ALIGNED, jacobian);
        pinocchio::updateFramePlacement(model, data, tip);
    });
}

// What the last call found: the tip, its axes, then the Jacobian column by column.
void result(double *position, double *axes, double *columns) {
    Eigen::Map<Eigen::Vector3d>{position} = data.oMf[tip].translation();
    Eigen::Map<Eigen::Matrix3d>{axes} = data.oMf[tip].rotation();
    Eigen::Map<Jacobian>{columns} = jacobian;
}
}
