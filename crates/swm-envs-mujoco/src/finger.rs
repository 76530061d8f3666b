//! `swm/FingerDMControl-v0`: a finger that turns a spinner. Source: `dm_control`'s `suite/finger.py` and `finger.xml`.

use std::f64::consts::PI;

use swm_core::seed::Stream;
use swm_core::{EnvEntry, EnvTask};

use crate::suite::{
    Control, Domain, Effect, Place, Stage, Target, Task, TaskEntry, distance, entry, factors, listed, make,
    planner, randomize_joints, recall_touch, uniform, until_free_of_contacts,
};
use swm_mujoco::MujocoError;
use swm_mujoco::{Model, Object, Shape, Spec};

/// The table entry.
pub const FINGER: EnvEntry = entry(&DOMAIN, |config| make(&DOMAIN, config)).tasks(&LISTED);

pub(crate) static DOMAIN: Domain = Domain {
    id: "swm/FingerDMControl-v0",
    summary: "turn a spinner with a finger of two links; two torques",
    success: "the tip in the target",
    model: "finger.xml",
    substeps: 2,
    time_limit_s: 20.0,
    camera: 0,
    tasks: TASKS,
    planner: planner!("horizon=40,samples=32,iterations=2,elites=6,sigma=1,aggregate=mean"),
    policies: &[],
    infos: &[("hinge_velocity", 0), ("target_position", 2), ("tip_position", 2)],
    targets: &[Target { column: "target_pos", place: Place::SitePosition("target") }],
    start_columns: &["qpos", "qvel", "time", "qacc_warmstart", "target_pos"],
    compose,
    factors: controls,
};

const LISTED: [EnvTask; TASKS.len()] = listed(TASKS);

const TASKS: &[TaskEntry] = &[
    TaskEntry::new("turn_hard", "turn the spinner's tip into a target of 3 cm", |model| {
        Finger::new(model, true)
    })
    .goal_columns(&["tip_position"]),
    TaskEntry::new("turn_easy", "turn the spinner's tip into a target of 7 cm", |model| {
        Finger::new(model, true)
    })
    .goal_columns(&["tip_position"]),
    TaskEntry::new("spin", "turn at 15 rad/s or more", |model| Finger::new(model, false)),
];

fn compose(spec: &mut Spec, task: &str) -> Result<(), MujocoError> {
    match task {
        "spin" => {
            spec.site("target")?.set_rgba(HIDDEN);
            spec.site("tip")?.set_rgba(HIDDEN);
            spec.joint("hinge")?.set_damping(0.03);
        }
        "turn_easy" => {
            spec.site("target")?.set_size([0.07; 3]);
        }
        _ => {
            spec.site("target")?.set_size([0.03; 3]);
        }
    }
    Ok(())
}

/// Not drawn.
const HIDDEN: [f32; 4] = [0.5, 0.5, 0.5, 0.0];

fn controls(stock: bool) -> Vec<Control> {
    vec![
        factors::agent_color([0.7, 0.5, 0.3]),
        factors::density(
            "agent.fingertip_density",
            "density of the fingertip, kg/m³",
            Effect::Density(&["fingertip"]),
        ),
        factors::density(
            "agent.proximal_density",
            "density of the upper link, kg/m³",
            Effect::Density(&["proximal"]),
        ),
        factors::floor_color(),
        factors::light_intensity("light", if stock { 0.6 } else { 0.7 }),
        factors::color(
            "spinner.color",
            [0.7, 0.5, 0.3],
            "color of the spinner",
            Effect::Model(|model, values| factors::set_geom_color(model, &["cap1", "cap2"], values)),
        ),
        factors::density(
            "spinner.density",
            "density of the spinner, kg/m³",
            Effect::Density(&["cap1", "cap2"]),
        ),
        factors::scalar(
            "spinner.friction",
            [0.0, 1.0],
            0.1,
            "dry friction of the spinner's hinge, N m",
            Effect::Model(|model, values| {
                let (_, dof) = model.joint_addresses(model.id(Object::Joint, "hinge")?);
                model.dof_frictionloss_mut()[dof] = values[0];
                Ok(())
            }),
        ),
        factors::color(
            "target.color",
            [0.6, 0.3, 0.3],
            "color of the target; the spinner's tip keeps its own",
            Effect::Model(|model, values| {
                let site = model.id(Object::Site, "target")?;
                factors::set_site_color(model, site, values);
                Ok(())
            }),
        ),
        factors::target_shape(
            "1: the target is a ball; 0: a cube as wide. The reward counts a disc either way",
            Effect::Model(|model, values| {
                if values[0] == 0.0 {
                    let site = model.id(Object::Site, "target")?;
                    model.set_site_shape(site, Shape::Box);
                }
                Ok(())
            }),
        ),
    ]
}

/// Speed that `spin` asks for, rad/s.
const SPIN_VELOCITY: f64 = 15.0;
/// Tries of placing the joints where nothing touches, as in the suite.
const TRIES: u32 = 1000;

struct Finger {
    /// Whether there is a target to turn to.
    turns: bool,
    target: usize,
    spinner: usize,
    /// From the hinge to the spinner's tip, m.
    radius: f64,
    sensors: Sensors,
}

/// Indices of the sensors.
struct Sensors {
    angles: [usize; 2],
    velocities: [usize; 3],
    touch: [usize; 2],
    tip: usize,
    target: usize,
    spinner: usize,
}

impl Finger {
    #[expect(clippy::new_ret_no_self, reason = "tasks are made as trait objects")]
    fn new(model: &Model, turns: bool) -> Result<Box<dyn Task>, MujocoError> {
        let sensor = |name: &str| model.id(Object::Sensor, name);
        let sensors = Sensors {
            angles: [sensor("proximal")?, sensor("distal")?],
            velocities: [sensor("proximal_velocity")?, sensor("distal_velocity")?, sensor("hinge_velocity")?],
            touch: [sensor("touchtop")?, sensor("touchbottom")?],
            tip: sensor("tip")?,
            target: sensor("target")?,
            spinner: sensor("spinner")?,
        };
        let cap = model.id(Object::Geom, "cap1")?;
        let radius = model.geom_size()[3 * cap..][..3].iter().sum();
        let (target, spinner) = (model.id(Object::Site, "target")?, model.id(Object::Body, "spinner")?);
        Ok(Box::new(Self { turns, target, spinner, radius, sensors }))
    }

    /// Where a sensor's point is from the hinge, in the plane of x and z, m.
    fn beside_hinge(&self, stage: &Stage, sensor: usize) -> [f64; 2] {
        let (point, hinge) = (stage.sim.sensor(sensor), stage.sim.sensor(self.sensors.spinner));
        [point[0] - hinge[0], point[2] - hinge[2]]
    }

    /// From the tip to the rim of the target, m; negative inside.
    fn to_target(&self, stage: &Stage) -> f64 {
        let (target, tip) =
            (self.beside_hinge(stage, self.sensors.target), self.beside_hinge(stage, self.sensors.tip));
        distance(target, tip) - stage.sim.model().site_size()[3 * self.target]
    }

    fn hinge_velocity(&self, stage: &Stage) -> f64 {
        stage.sim.sensor(self.sensors.velocities[2])[0]
    }

    /// Puts the target at a point of the plane of x and z, counted from the hinge.
    fn place_target(&self, stage: &mut Stage, [x, z]: [f64; 2]) {
        let (hinge, depth) = (stage.sim.xpos(self.spinner), stage.target(0)[1]);
        stage.set_target(0, &[hinge[0] + x, depth, hinge[2] + z]);
    }
}

impl Task for Finger {
    fn start(&self, stage: &mut Stage, stream: &mut Stream) -> Result<(), MujocoError> {
        if self.turns {
            let angle = uniform(stream, -PI, PI);
            self.place_target(stage, [self.radius * angle.sin(), self.radius * angle.cos()]);
        }
        until_free_of_contacts(stage, TRIES, |stage, _| {
            randomize_joints(&mut stage.sim, stream);
            Ok(())
        })
    }

    fn observe(&self, stage: &Stage, out: &mut Vec<f64>) {
        let number = |sensor: usize| stage.sim.sensor(sensor)[0];
        out.extend(self.sensors.angles.map(number));
        out.extend(self.beside_hinge(stage, self.sensors.tip));
        out.extend(self.sensors.velocities.map(number));
        out.extend(self.sensors.touch.map(number).map(f64::ln_1p));
        if self.turns {
            out.extend(self.beside_hinge(stage, self.sensors.target));
            out.push(self.to_target(stage));
        }
    }

    fn recall(&self, stage: &mut Stage, observation: &[f64]) {
        // Behind two angles, the tip's place and three velocities.
        recall_touch(stage, &self.sensors.touch, &observation[7..]);
    }

    fn reward(&self, stage: &Stage) -> f64 {
        let rewarded = if self.turns {
            self.to_target(stage) <= 0.0
        } else {
            self.hinge_velocity(stage) <= -SPIN_VELOCITY
        };
        if rewarded { 1.0 } else { 0.0 }
    }

    fn cost(&self, stage: &Stage) -> Option<f64> {
        // Beside what is wanted: the fingertip near the spinner, without which nothing moves.
        let sim = &stage.sim;
        let reach = self.sensors.touch.map(|sensor| sim.sensor(sensor)[0]).iter().sum::<f64>();
        let touching = if reach > 0.0 { 0.0 } else { 0.05 };
        Some(if self.turns {
            self.to_target(stage).max(0.0) + touching
        } else {
            self.hinge_velocity(stage) / SPIN_VELOCITY + touching
        })
    }

    fn success(&self, stage: &Stage) -> Option<bool> {
        self.turns.then(|| self.to_target(stage) <= 0.0)
    }

    fn infos(&self, stage: &Stage, out: &mut Vec<f64>) {
        out.push(self.hinge_velocity(stage));
        out.extend(self.beside_hinge(stage, self.sensors.target));
        out.extend(self.beside_hinge(stage, self.sensors.tip));
    }

    fn set_goal(&self, stage: &mut Stage, _column: &str, values: &[f64]) {
        self.place_target(stage, [values[0], values[1]]);
    }
}
