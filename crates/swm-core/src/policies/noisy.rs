//! Experts whose actions can carry normal noise: the policies `expert` and `noisy-expert:STD` of an environment.

use crate::batch::SliceMut;
use crate::error::PolicyError;
use crate::policy::{Actor, PerEpisode, Policy, SlotView, add_noise, write_action};
use crate::registry::{NoArgs, PolicyArgs, PolicyContext, PolicyEntry};
use crate::settings::{Settings as _, Table};

/// An expert of actions of `N` values, in one episode. [`expert`] and [`noisy_expert`] make policies of it.
pub trait NoisyExpert<const N: usize>: Sized + Send + 'static {
    /// What it does without noise, in one line.
    const SUMMARY: &'static str;
    /// The standard deviation of `noisy-expert` without arguments.
    const STD: &'static str;
    /// Purpose of the random stream of the noise.
    const STREAM: &'static str = "policy expert noise";
    /// What all episodes share.
    type Shared: Send + Sync + 'static;

    /// Reads what all episodes share from the settings of the environment.
    ///
    /// # Errors
    ///
    /// A setting has a value that it cannot have.
    fn shared(context: &PolicyContext<'_>) -> Result<Self::Shared, PolicyError>;

    /// The expert at the start of an episode.
    ///
    /// # Errors
    ///
    /// The environment is another one.
    fn new(shared: &Self::Shared, view: &SlotView<'_>) -> Result<Self, PolicyError>;

    /// The action without noise. With it, it is clipped to the action space.
    ///
    /// # Errors
    ///
    /// As of [`Policy::act`].
    fn choose(&mut self, view: &SlotView<'_>) -> Result<[f64; N], PolicyError>;
}

crate::settings! {
    /// Arguments of the noisy expert. Unknown names are refused.
    struct Noise {
        /// Standard deviation of the noise on each component of an action.
        std: f64 = 0.0,
    }
}

/// The entry `expert`.
pub const fn expert<E: NoisyExpert<N>, const N: usize>() -> PolicyEntry {
    PolicyEntry::new("expert", E::SUMMARY, |context, args| {
        args.parse_as::<NoArgs>()?;
        policy::<E, N>(context, args, 0.0)
    })
}

/// The entry `noisy-expert`.
pub const fn noisy_expert<E: NoisyExpert<N>, const N: usize>() -> PolicyEntry {
    noisy::<E, N>("noisy-expert", "the expert with normal noise on its actions (`noisy-expert:STD`)")
}

/// An entry like `noisy-expert`, with another name.
pub const fn noisy<E: NoisyExpert<N>, const N: usize>(
    name: &'static str,
    summary: &'static str,
) -> PolicyEntry {
    PolicyEntry::new(name, summary, |context, args| {
        let mut given = args.clone();
        given.named.entry("std").or_insert_with(|| E::STD.parse().unwrap_or_default());
        let Noise { std } = given.parse_with("std")?;
        args.check_not_negative("std", std)?;
        policy::<E, N>(context, args, std)
    })
    .settings(const { &Table::of(&[Noise::SETTINGS]).with_default("std", E::STD) }.as_slice())
}

fn policy<E: NoisyExpert<N>, const N: usize>(
    context: &PolicyContext<'_>,
    args: &PolicyArgs,
    std: f64,
) -> Result<Box<dyn Policy>, PolicyError> {
    let shared = E::shared(context)?;
    let description = if std > 0.0 { format!("{}:std={std}", args.name) } else { args.name.clone() };
    Ok(Box::new(PerEpisode::new(description, move |view: &SlotView<'_>| {
        let (low, high) = view.spec.action.bounds();
        let bounds = std::array::from_fn(|k| [low[k], high[k]]);
        Ok(Box::new(Noisy { expert: E::new(&shared, view)?, std, bounds }) as Box<dyn Actor>)
    })))
}

/// An expert with noise, in one episode.
struct Noisy<E, const N: usize> {
    expert: E,
    std: f64,
    /// Bounds of each component of an action.
    bounds: [[f64; 2]; N],
}

impl<E: NoisyExpert<N>, const N: usize> Actor for Noisy<E, N> {
    fn act(&mut self, view: &SlotView<'_>, mut action: SliceMut<'_>) -> Result<(), PolicyError> {
        let mut chosen = self.expert.choose(view)?;
        add_noise(view, E::STREAM, self.std, &mut chosen);
        for (value, [low, high]) in chosen.iter_mut().zip(self.bounds) {
            *value = value.clamp(low, high);
        }
        write_action(&mut action, &chosen.map(|value| value as f32));
        Ok(())
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::batch::Slice;
    use crate::registry::Registry;
    use crate::testing::TOY;
    use crate::{World, WorldOptions};

    /// Chooses 0.9.
    struct Near;

    impl NoisyExpert<1> for Near {
        const SUMMARY: &'static str = "chooses 0.9";
        const STD: &'static str = "0.25";
        type Shared = ();

        fn shared(_: &PolicyContext<'_>) -> Result<(), PolicyError> {
            Ok(())
        }

        fn new(_: &(), _: &SlotView<'_>) -> Result<Self, PolicyError> {
            Ok(Self)
        }

        fn choose(&mut self, _: &SlotView<'_>) -> Result<[f64; 1], PolicyError> {
            Ok([0.9])
        }
    }

    #[test]
    fn noise_is_added_then_clipped_and_described() {
        let entry = TOY.policies(const { &[expert::<Near, 1>(), noisy_expert::<Near, 1>()] });
        assert_eq!(entry.policies[1].settings[0].default, "0.25");
        let actions = |text: &str| {
            let mut world = World::new(&entry, WorldOptions::new(1)).unwrap();
            world.set_policy(Registry::new().policy(text, &world)?).unwrap();
            world.reset(3, &crate::env::ResetOptions::default()).unwrap();
            world.step().unwrap();
            let Slice::F32(&[action]) = world.actions() else { panic!("the toy's actions are one f32") };
            Ok::<_, PolicyError>((action, world.policy_description().unwrap()))
        };
        assert_eq!(actions("expert").unwrap(), (0.9, "expert".to_owned()));
        let (noisy, description) = actions("noisy-expert").unwrap();
        assert_eq!(description, "noisy-expert:std=0.25");
        assert_ne!(noisy, 0.9);
        assert_eq!(actions("noisy-expert:0.25").unwrap().0, noisy);
        assert_eq!(actions("noisy-expert:std=1e9").unwrap().0.abs(), 1.0, "clipped to the action space");
        assert!(actions("noisy-expert:-1").is_err() && actions("noisy-expert:sdt=1").is_err());
    }
}
