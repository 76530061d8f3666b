//! Transformers that look at a history of frames and at a goal: policies, values, critics. Blocks look at the frames and at
//! the goal by turns; then each frame becomes one vector. [`metric`](super::metric) is built of the same blocks.

use burn::module::{Module, ModuleDisplay, Param};
use burn::tensor::activation::relu;
use burn::tensor::{Bool, Device, FloatDType, Tensor, TensorData};
use serde::{Deserialize, Serialize};

use super::attention::{Attend, FeedForward, attend, join, split};
use super::linear::{Linear, parameter};
use super::norm::LayerNorm;
use crate::pass::Pass;

/// Their size. The defaults are the reference's.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct GoalTransformerConfig {
    /// Blocks.
    pub depth: usize,
    /// Heads of attention.
    pub heads: usize,
    /// Dim of an attention head.
    #[serde(alias = "head_width")]
    pub head_dim: usize,
    /// Hidden dim of the MLP after each attention.
    pub hidden: usize,
    /// Dropout rate.
    pub dropout: f64,
    /// How a frame becomes one vector.
    pub pool: Pool,
    /// Whether a frame is seen as what sets it apart from the goal: the tokens of both are normalized, and the goal's
    /// subtracted. Not the reference's: it lets a value find out in hundreds of steps which frame is the goal, where its
    /// encoder begins with random weights.
    pub compare: bool,
}

/// How the tokens of a frame become one vector.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Pool {
    /// The last block has one learned query per frame.
    Attention,
    /// Their mean.
    Mean,
}

impl Default for GoalTransformerConfig {
    fn default() -> Self {
        Self {
            depth: 6,
            heads: 16,
            head_dim: 64,
            hidden: 2048,
            dropout: 0.0,
            pool: Pool::Attention,
            compare: false,
        }
    }
}

/// The form of what they see.
#[derive(Clone, Copy, Debug)]
pub struct TokenForm {
    /// P: tokens of a frame.
    pub patches: usize,
    /// T: frames, at most.
    pub frames: usize,
    /// W: dim of a token.
    pub dim: usize,
}

/// A network that gives frames a value, depending on the goal.
pub trait ValueNetwork: Module + ModuleDisplay + 'static {
    /// `[B, T, P, W]` frames and `[B, 1, P, W]` goal → `[B, T, 1]`.
    fn value(&self, frames: Tensor<4>, goal: Tensor<4>, pass: &mut Pass) -> Tensor<3>;
}

/// Whose keys a block looks at.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Looks {
    AtFrames,
    AtGoal,
    /// From one query per frame.
    PerFrame,
}

#[derive(Module, Debug)]
struct GoalAttention {
    norm: LayerNorm,
    norm_c: Option<LayerNorm>,
    to_q: Linear,
    to_kv: Linear,
    to_out: Option<Linear>,
    /// `[1, T, W]`.
    frame_tokens: Option<Param<Tensor<3>>>,
    #[module(skip)]
    config: GoalTransformerConfig,
    #[module(skip)]
    looks: Looks,
    #[module(skip)]
    patches: usize,
}

/// Attention, then the network between two of them.
#[derive(Module, Debug)]
pub(super) struct AttentionPair {
    attention: GoalAttention,
    feed_forward: FeedForward,
}

#[derive(Module, Debug)]
struct GoalTransformer {
    norm: LayerNorm,
    layers: Vec<AttentionPair>,
    /// Where frames are compared with the goal.
    token_norm: Option<LayerNorm>,
    #[module(skip)]
    pool: Pool,
    #[module(skip)]
    patches: usize,
}

impl GoalAttention {
    fn new(config: &GoalTransformerConfig, looks: Looks, form: &TokenForm, device: &Device) -> Self {
        let &TokenForm { patches, frames, dim } = form;
        let inner = config.heads * config.head_dim;
        let projects = !(config.heads == 1 && config.head_dim == dim);
        Self {
            norm: LayerNorm::new(dim, device),
            norm_c: (looks == Looks::AtGoal).then(|| LayerNorm::new(dim, device)),
            to_q: Linear::without_bias(dim, inner, device),
            to_kv: Linear::without_bias(dim, 2 * inner, device),
            to_out: projects.then(|| Linear::new(inner, dim, device)),
            frame_tokens: (looks == Looks::PerFrame).then(|| parameter([1, frames, dim], device)),
            config: config.clone(),
            looks,
            patches,
        }
    }

    fn forward(&self, input: Tensor<3>, goal: Option<Tensor<3>>, pass: &mut Pass) -> Tensor<3> {
        let [batch, count, dim] = input.dims();
        let frames = count / self.patches;
        let input = self.norm.forward(input);
        let (queries, keys, who) = match (&self.norm_c, goal, &self.frame_tokens) {
            (Some(norm), Some(goal), _) => (input, norm.forward(goal), Attend::All),
            (_, _, Some(tokens)) => {
                let queries = tokens.val().narrow(1, 0, frames).expand([batch, frames, dim]);
                let who = later_frames(frames, 1, self.patches, &input);
                (queries, input, who)
            }
            _ => {
                let who = later_frames(frames, self.patches, self.patches, &input);
                (input.clone(), input, who)
            }
        };
        let q = self.to_q.forward_narrow(queries);
        let kv: [Tensor<3>; 2] = self
            .to_kv
            .forward_narrow(keys)
            .chunk(2, 2)
            .try_into()
            .expect("two parts of a dim that two divides");
        let [k, v] = kv;
        let heads = [q, k, v].map(|part| split(part, self.config.heads));
        let output = join(attend(heads, &who, self.config.dropout, pass));
        match &self.to_out {
            Some(to_out) => pass.dropout(to_out.forward(output), self.config.dropout),
            None => output.cast(FloatDType::F32),
        }
    }
}

/// Queries of a frame see the keys of their own and earlier frames: `[1, 1, frames × queries, frames × keys]`, true where
/// they do not.
pub(crate) fn later_frames(frames: usize, queries: usize, keys: usize, like: &Tensor<3>) -> Attend {
    if frames == 1 {
        return Attend::All;
    }
    let hidden = (0..frames * queries)
        .flat_map(|query| (0..frames * keys).map(move |key| key / keys > query / queries));
    let data = TensorData::new(hidden.collect::<Vec<bool>>(), [1, 1, frames * queries, frames * keys]);
    Attend::Unless(Tensor::<4, Bool>::from_data(data, &like.device().inner()))
}

impl AttentionPair {
    /// One of a transformer's blocks.
    pub(super) fn new(
        config: &GoalTransformerConfig,
        looks: Looks,
        form: &TokenForm,
        device: &Device,
    ) -> Self {
        Self {
            attention: GoalAttention::new(config, looks, form, device),
            feed_forward: FeedForward::new(form.dim, config.hidden, config.dropout, device),
        }
    }

    /// `[B, T × P, W]`, and `[B, P, W]` of the goal where the block looks at it → `[B, T × P, W]`; one that looks per frame
    /// gives `[B, T, W]`, and has no residuals.
    pub(super) fn forward(&self, state: Tensor<3>, goal: Option<Tensor<3>>, pass: &mut Pass) -> Tensor<3> {
        let seen = self.attention.forward(state.clone(), goal, pass);
        if self.attention.looks == Looks::PerFrame {
            return self.feed_forward.forward(seen, pass);
        }
        let state = seen + state;
        self.feed_forward.forward(state.clone(), pass) + state
    }
}

impl GoalTransformer {
    fn new(config: &GoalTransformerConfig, form: &TokenForm, device: &Device) -> Self {
        let block = |index| {
            let is_last = index + 1 == config.depth && config.pool == Pool::Attention;
            let looks = match index % 2 {
                _ if is_last => Looks::PerFrame,
                0 => Looks::AtFrames,
                _ => Looks::AtGoal,
            };
            AttentionPair::new(config, looks, form, device)
        };
        Self {
            norm: LayerNorm::new(form.dim, device),
            layers: (0..config.depth).map(block).collect(),
            token_norm: config.compare.then(|| LayerNorm::plain(1e-5)),
            pool: config.pool,
            patches: form.patches,
        }
    }

    /// `[B, T, P, W]` frames and `[B, 1, P, W]` goal, each with its table of positions → `[B, T, W]`.
    fn forward(
        &self,
        [frames, goal]: [Tensor<4>; 2],
        [positions, positions_goal]: [&Param<Tensor<3>>; 2],
        pass: &mut Pass,
    ) -> Tensor<3> {
        let [frames, goal] = match &self.token_norm {
            Some(norm) => {
                let (frames, goal) = (norm.forward(frames), norm.forward(goal));
                [frames.clone() - goal.clone().expand(frames.dims()), goal]
            }
            None => [frames, goal],
        };
        let mut state = placed(frames, positions);
        let goal = placed(goal, positions_goal);
        for layer in &self.layers {
            state = layer.forward(state, Some(goal.clone()), pass);
        }
        if self.pool == Pool::Mean {
            let [batch, count, dim] = state.dims();
            let by_frame = state.reshape([batch, count / self.patches, self.patches, dim]);
            state = by_frame.mean_dim(2).squeeze_dim(2);
        }
        self.norm.forward(state)
    }
}

/// One vector per frame: an action, or a value.
#[derive(Module, Debug)]
pub struct GoalPredictor {
    /// `[1, T × P, W]`.
    pos_embedding: Param<Tensor<3>>,
    /// `[1, P, W]`.
    pos_embedding_goal: Param<Tensor<3>>,
    transformer: GoalTransformer,
    out_proj: Linear,
}

impl GoalPredictor {
    /// With so many outputs per frame.
    pub fn new(config: &GoalTransformerConfig, form: &TokenForm, outputs: usize, device: &Device) -> Self {
        Self {
            pos_embedding: parameter([1, form.frames * form.patches, form.dim], device),
            pos_embedding_goal: parameter([1, form.patches, form.dim], device),
            transformer: GoalTransformer::new(config, form, device),
            out_proj: Linear::new(form.dim, outputs, device),
        }
    }

    /// `[B, T, P, W]` frames and `[B, 1, P, W]` goal → `[B, T, outputs]`.
    pub fn forward(&self, frames: Tensor<4>, goal: Tensor<4>, pass: &mut Pass) -> Tensor<3> {
        let positions = [&self.pos_embedding, &self.pos_embedding_goal];
        self.out_proj.forward(self.transformer.forward([frames, goal], positions, pass))
    }
}

impl ValueNetwork for GoalPredictor {
    fn value(&self, frames: Tensor<4>, goal: Tensor<4>, pass: &mut Pass) -> Tensor<3> {
        self.forward(frames, goal, pass)
    }
}

/// `[B, T, P, W]` → `[B, T × P, W]`, with the first positions of a table added.
pub(super) fn placed(tokens: Tensor<4>, positions: &Param<Tensor<3>>) -> Tensor<3> {
    let tokens: Tensor<3> = tokens.flatten(1, 2);
    let count = tokens.dims()[1];
    tokens + positions.val().narrow(1, 0, count)
}

/// The value of actions: they join each frame's vector behind the transformer.
#[derive(Module, Debug)]
pub struct Critic {
    pos_embedding: Param<Tensor<3>>,
    pos_embedding_goal: Param<Tensor<3>>,
    transformer: GoalTransformer,
    q_head: QHead,
}

/// Three linear layers with ReLU between them, to one value.
#[derive(Module, Debug)]
pub struct QHead {
    first: Linear,
    second: Linear,
    third: Linear,
}

impl QHead {
    /// With these hidden dims.
    pub fn new(inputs: usize, [first, second]: [usize; 2], device: &Device) -> Self {
        Self {
            first: Linear::new(inputs, first, device),
            second: Linear::new(first, second, device),
            third: Linear::new(second, 1, device),
        }
    }

    /// `[…, inputs]` → `[…, 1]`.
    pub fn forward<const D: usize>(&self, input: Tensor<D>) -> Tensor<D> {
        let hidden = relu(self.first.forward(input));
        self.third.forward(relu(self.second.forward(hidden)))
    }
}

impl Critic {
    /// For actions of dim `actions`, with a head of hidden dim `hidden`.
    pub fn new(
        config: &GoalTransformerConfig,
        form: &TokenForm,
        actions: usize,
        hidden: usize,
        device: &Device,
    ) -> Self {
        Self {
            pos_embedding: parameter([1, form.frames * form.patches, form.dim], device),
            pos_embedding_goal: parameter([1, form.patches, form.dim], device),
            transformer: GoalTransformer::new(config, form, device),
            q_head: QHead::new(form.dim + actions, [hidden, hidden], device),
        }
    }

    /// `[B, T, P, W]` frames, `[B, T, A]` actions and `[B, 1, P, W]` goal → `[B, T, 1]`.
    pub fn forward(
        &self,
        frames: Tensor<4>,
        actions: Tensor<3>,
        goal: Tensor<4>,
        pass: &mut Pass,
    ) -> Tensor<3> {
        let positions = [&self.pos_embedding, &self.pos_embedding_goal];
        let states = self.transformer.forward([frames, goal], positions, pass);
        self.q_head.forward(Tensor::cat(vec![states, actions], 2))
    }
}
