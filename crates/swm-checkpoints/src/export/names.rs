//! Names of a vision transformer's tensors in transformers 4 and 5. Here they are nearly those of 5.

/// A version of transformers.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Generation {
    Four,
    Five,
}

/// The vision transformer of a model.
#[derive(Clone, Copy, Debug)]
pub(super) struct Encoder {
    /// What the names of its tensors begin with, here as there: `encoder.`.
    pub(super) prefix: &'static str,
    /// Whether it is a DINOv2, which keeps more of the old names.
    pub(super) dinov2: bool,
}

/// Parts of a layer here, in 4, and in 5; of both families.
const ATTENTION: [[&str; 3]; 4] = [
    ["attention.q_proj.", "attention.attention.query.", "attention.q_proj."],
    ["attention.k_proj.", "attention.attention.key.", "attention.k_proj."],
    ["attention.v_proj.", "attention.attention.value.", "attention.v_proj."],
    ["attention.o_proj.", "attention.output.dense.", "attention.o_proj."],
];

/// The same, of ViT alone.
const VIT: [[&str; 3]; 4] = [
    ["norm1.", "layernorm_before.", "layernorm_before."],
    ["norm2.", "layernorm_after.", "layernorm_after."],
    ["mlp.fc1.", "intermediate.dense.", "mlp.fc1."],
    ["mlp.fc2.", "output.dense.", "mlp.fc2."],
];

impl Generation {
    pub(super) fn of(version: usize) -> Option<Self> {
        match version {
            4 => Some(Self::Four),
            5 => Some(Self::Five),
            _ => None,
        }
    }

    /// That of the names of an imported checkpoint.
    pub(super) fn named(names: &str) -> Option<Self> {
        Self::of(names.strip_prefix("transformers ")?.parse().ok()?)
    }

    pub(super) fn version(self) -> usize {
        match self {
            Self::Four => 4,
            Self::Five => 5,
        }
    }
}

impl Encoder {
    /// The name there of a tensor of the encoder, with its prefix.
    pub(super) fn theirs(&self, name: &str, generation: Generation) -> String {
        let inner = name.strip_prefix(self.prefix).unwrap_or(name);
        format!("{}{}", self.prefix, self.inner(inner, generation))
    }

    /// The same without the prefix.
    pub(super) fn inner(&self, name: &str, generation: Generation) -> String {
        let Some((index, part)) = name.strip_prefix("layers.").and_then(|rest| rest.split_once('.')) else {
            return name.to_owned();
        };
        let known = ATTENTION.iter().chain(VIT.iter().filter(|_| !self.dinov2));
        let found = known.into_iter().find_map(|[ours, four, five]| {
            let rest = part.strip_prefix(ours)?;
            Some(format!("{}{rest}", if generation == Generation::Four { four } else { five }))
        });
        let part = found.unwrap_or_else(|| part.to_owned());
        match (generation, self.dinov2) {
            (Generation::Five, false) => format!("layers.{index}.{part}"),
            _ => format!("encoder.layer.{index}.{part}"),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use swm_baselines::weights::ours;

    #[test]
    fn names_of_both_generations_come_back() {
        let parts = ["attention.q_proj.weight", "attention.o_proj.bias", "norm1.weight", "mlp.fc2.bias"];
        for dinov2 in [false, true] {
            let encoder = Encoder { prefix: "encoder.", dinov2 };
            for part in parts {
                let name = format!("encoder.layers.11.{part}");
                for generation in [Generation::Four, Generation::Five] {
                    assert_eq!(ours(&encoder.theirs(&name, generation)), name, "{generation:?} {dinov2}");
                }
            }
        }
        let vit = Encoder { prefix: "encoder.", dinov2: false };
        let dino = Encoder { prefix: "backbone.", dinov2: true };
        let query = "layers.0.attention.q_proj.weight";
        for (found, wanted) in [
            (vit.inner(query, Generation::Four), "encoder.layer.0.attention.attention.query.weight"),
            (vit.inner(query, Generation::Five), "layers.0.attention.q_proj.weight"),
            (vit.inner("layers.0.norm2.bias", Generation::Five), "layers.0.layernorm_after.bias"),
            (dino.inner(query, Generation::Five), "encoder.layer.0.attention.q_proj.weight"),
            (dino.inner("layers.0.norm2.bias", Generation::Four), "encoder.layer.0.norm2.bias"),
            (dino.inner("layers.0.mlp.fc1.bias", Generation::Four), "encoder.layer.0.mlp.fc1.bias"),
            (vit.inner("embeddings.cls_token", Generation::Four), "embeddings.cls_token"),
        ] {
            assert_eq!(found, wanted);
        }
    }

    #[test]
    fn generations_are_known_by_their_names() {
        assert_eq!(Generation::named("transformers 5"), Some(Generation::Five));
        assert_eq!((Generation::named("PyTorch"), Generation::of(3)), (None, None));
    }
}
