"""Tiny models of the classes that the big ones have, written to folders as the big ones come."""

from __future__ import annotations

import warnings
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import torch
import transformers
from transformers.models.clip.image_processing_pil_clip import CLIPImageProcessorPil
from transformers.models.detr.image_processing_pil_detr import DetrImageProcessorPil
from transformers.models.dpt.image_processing_pil_dpt import DPTImageProcessorPil
from transformers.models.grounding_dino.image_processing_pil_grounding_dino import GroundingDinoImageProcessorPil
from transformers.models.owlv2.image_processing_pil_owlv2 import Owlv2ImageProcessorPil
from transformers.models.siglip.image_processing_pil_siglip import SiglipImageProcessorPil

#: Where BERT's vocabulary has its marks, which Grounding DINO knows by number.
_BERT_MARKS = {0: "[PAD]", 100: "[UNK]", 101: "[CLS]", 102: "[SEP]", 103: "[MASK]", 1012: ".", 1029: "?"}
_PIECES = ("couch", "wardrobe", "bed", "fire", "extinguisher", "pot", "##ted", "##plant", "a", "tv", "no", "5")


def saved(model: Any, folder: Path, *others: Any) -> Path:
    """The folder, with the model and what goes with it."""
    folder.mkdir(parents=True, exist_ok=True)
    for thing in (model, *others):
        thing.save_pretrained(folder)
    return folder


def bert_tokenizer(words: Sequence[str] = ()) -> Any:
    """WordPiece of a few words, with BERT's marks at BERT's numbers."""
    vocabulary = [_BERT_MARKS.get(i, f"[unused{i}]") for i in range(1030)]
    vocabulary += dict.fromkeys((*_PIECES, *(piece for word in words for piece in word.split())))
    return transformers.BertTokenizer(vocab={token: i for i, token in enumerate(vocabulary)}, do_lower_case=True)


def clip_tokenizer(most_tokens: int = 77) -> Any:
    """CLIP's, of single bytes: no pieces of words are joined."""
    signs = _byte_signs()
    vocabulary = [*signs, *(f"{sign}</w>" for sign in signs), "<|startoftext|>", "<|endoftext|>"]
    numbers = {token: i for i, token in enumerate(vocabulary)}
    return transformers.CLIPTokenizer(vocab=numbers, merges=[], model_max_length=most_tokens)


def _byte_signs() -> list[str]:
    """The printable signs that byte-level tokenizers write for bytes."""
    printable = [*range(33, 127), *range(161, 173), *range(174, 256)]
    return [chr(b) for b in printable] + [chr(256 + i) for i in range(256 - len(printable))]


def swin(image_size: int = 96) -> Any:
    return transformers.SwinConfig(
        image_size=image_size,
        embed_dim=16,
        depths=[1, 1, 1, 1],
        num_heads=[1, 2, 2, 4],
        window_size=4,
        out_features=["stage2", "stage3", "stage4"],
        drop_path_rate=0.0,
    )


def grounding_dino_model(n_vocabulary: int, *, mm: bool = False, **more: Any) -> Any:
    """A Grounding DINO of half a million weights."""
    bert = transformers.BertConfig(
        vocab_size=n_vocabulary,
        hidden_size=32,
        num_hidden_layers=1,
        num_attention_heads=2,
        intermediate_size=64,
        hidden_dropout_prob=0.0,
        attention_probs_dropout_prob=0.0,
    )
    sizes = {
        "d_model": 64,
        "encoder_layers": 1,
        "decoder_layers": 2,
        "encoder_attention_heads": 4,
        "decoder_attention_heads": 4,
        "encoder_ffn_dim": 128,
        "decoder_ffn_dim": 128,
        "num_queries": 20,
        "num_feature_levels": 3,
        "dropout": 0.0,
        "fusion_droppath": 0.0,
    }
    config, model = (
        (transformers.MMGroundingDinoConfig, transformers.MMGroundingDinoForObjectDetection)
        if mm
        else (transformers.GroundingDinoConfig, transformers.GroundingDinoForObjectDetection)
    )
    return model(config(backbone_config=swin(), text_config=bert, **{**sizes, **more}))


def grounding_dino(folder: Path, *, mm: bool = False) -> Path:
    torch.manual_seed(0)
    tokenizer = bert_tokenizer()
    images = GroundingDinoImageProcessorPil(size={"shortest_edge": 64, "longest_edge": 96})
    return saved(_spread(grounding_dino_model(len(tokenizer), mm=mm)), folder, tokenizer, images)


def _spread(model: Any, head: str = "bbox_embed", std: float = 0.05) -> Any:
    """With such weights in the head of boxes that an untrained model's differ, and are neither points nor the picture."""
    for name, weight in model.named_parameters():
        if head in name and weight.ndim == 2:
            torch.nn.init.normal_(weight, std=std)
    return model


def omdet_turbo(folder: Path) -> Path:
    torch.manual_seed(0)
    tokenizer = clip_tokenizer()
    text = transformers.CLIPTextConfig(
        vocab_size=len(tokenizer),
        hidden_size=48,
        intermediate_size=64,
        num_hidden_layers=1,
        num_attention_heads=2,
        projection_dim=48,
        bos_token_id=len(tokenizer) - 2,
        eos_token_id=len(tokenizer) - 1,
    )
    config = transformers.OmDetTurboConfig(
        backbone_config=swin(64),
        text_config=text,
        image_size=64,
        num_queries=20,
        encoder_hidden_dim=32,
        decoder_hidden_dim=32,
        vision_features_channels=[32, 32, 32],
        encoder_in_channels=[32, 64, 128],
        encoder_dim_feedforward=64,
        decoder_dim_feedforward=64,
        decoder_num_layers=2,
        encoder_attention_heads=4,
        decoder_num_heads=4,
        text_projection_in_dim=48,
        text_projection_out_dim=48,
        class_embed_dim=48,
        task_encoder_hidden_dim=64,
        apply_layernorm_after_vision_backbone=False,  # it is written for timm's order of axes
    )
    images = DetrImageProcessorPil(size={"height": 64, "width": 64}, do_pad=False)
    return saved(_spread(transformers.OmDetTurboForObjectDetection(config), "bbox_head"), folder, tokenizer, images)


def owlv2(folder: Path) -> Path:
    torch.manual_seed(0)
    tokenizer = clip_tokenizer(40)
    text = {"vocab_size": len(tokenizer), "hidden_size": 32, "intermediate_size": 64, "num_hidden_layers": 1, "num_attention_heads": 2, "max_position_embeddings": 40, "bos_token_id": 512, "eos_token_id": 513}  # fmt: skip  # noqa: E501
    vision = {"hidden_size": 32, "intermediate_size": 64, "num_hidden_layers": 1, "num_attention_heads": 2, "image_size": 96, "patch_size": 16}  # fmt: skip  # noqa: E501
    config = transformers.Owlv2Config(text_config=text, vision_config=vision, projection_dim=32)
    images = Owlv2ImageProcessorPil(size={"height": 96, "width": 96})
    return saved(_spread(transformers.Owlv2ForObjectDetection(config), "box_head"), folder, tokenizer, images)


def sam2(folder: Path) -> Path:
    torch.manual_seed(0)
    hiera = transformers.Sam2HieraDetConfig(
        hidden_size=16,
        num_attention_heads=1,
        image_size=[128, 128],
        blocks_per_stage=[1, 1, 2, 1],
        embed_dim_per_stage=[16, 32, 64, 128],
        num_attention_heads_per_stage=[1, 2, 4, 8],
        window_size_per_stage=[4, 4, 4, 4],
        global_attention_blocks=[3],
        window_positional_embedding_background_size=[4, 4],
    )
    vision = transformers.Sam2VisionConfig(
        backbone_config=hiera,
        backbone_channel_list=[128, 64, 32, 16],
        fpn_hidden_size=32,
        backbone_feature_sizes=[[32, 32], [16, 16], [8, 8]],
    )
    config = transformers.Sam2Config(
        vision_config=vision,
        prompt_encoder_config={"hidden_size": 32, "image_size": 128, "patch_size": 16},
        mask_decoder_config={"hidden_size": 32, "mlp_dim": 64, "iou_head_hidden_dim": 32},
    )
    return saved(transformers.Sam2Model(config), folder)


def clip_model(n_vocabulary: int) -> Any:
    text = {"vocab_size": n_vocabulary, "hidden_size": 32, "intermediate_size": 64, "num_hidden_layers": 1, "num_attention_heads": 2, "bos_token_id": n_vocabulary - 2, "eos_token_id": n_vocabulary - 1}  # fmt: skip  # noqa: E501
    vision = {"hidden_size": 32, "intermediate_size": 64, "num_hidden_layers": 2, "num_attention_heads": 2, "image_size": 32, "patch_size": 8}  # fmt: skip  # noqa: E501
    return transformers.CLIPModel(transformers.CLIPConfig(text_config=text, vision_config=vision, projection_dim=24))


def clip_images() -> Any:
    return CLIPImageProcessorPil(size={"shortest_edge": 32}, crop_size={"height": 32, "width": 32})


def clip(folder: Path) -> Path:
    torch.manual_seed(0)
    tokenizer = clip_tokenizer()
    return saved(clip_model(len(tokenizer)), folder, tokenizer, clip_images())


def siglip(folder: Path) -> Path:
    torch.manual_seed(0)
    letters = ["<pad>", "<eos>", "<bos>", "<unk>", "<mask>", "▁", *"abcdefghijklmnopqrstuvwxyz"]
    tokenizer = transformers.Siglip2Tokenizer(vocab={t: i for i, t in enumerate(letters)}, merges=[])
    text = {"vocab_size": len(letters), "hidden_size": 32, "intermediate_size": 64, "num_hidden_layers": 1, "num_attention_heads": 2, "projection_size": 32, "bos_token_id": 2, "eos_token_id": 1}  # fmt: skip  # noqa: E501
    vision = {"hidden_size": 32, "intermediate_size": 64, "num_hidden_layers": 1, "num_attention_heads": 2, "image_size": 32, "patch_size": 8}  # fmt: skip  # noqa: E501
    model = transformers.SiglipModel(transformers.SiglipConfig(text_config=text, vision_config=vision))
    return saved(model, folder, tokenizer, SiglipImageProcessorPil(size={"height": 32, "width": 32}))


class _SamEncoder(torch.nn.Module):
    def __init__(self, sam: Any) -> None:
        super().__init__()
        self.encoder = sam.vision_encoder

    def forward(self, image: torch.Tensor) -> torch.Tensor:
        return self.encoder(image, return_dict=True).last_hidden_state


class _SamDecoder(torch.nn.Module):
    """The inputs and outputs of SAM's documented ONNX export, for one box; masks come in the picture's size."""

    def __init__(self, sam: Any) -> None:
        super().__init__()
        self.sam, self.side = sam, sam.config.vision_config.image_size

    def forward(
        self,
        image_embeddings: torch.Tensor,
        point_coords: torch.Tensor,
        point_labels: torch.Tensor,
        mask_input: torch.Tensor,
        has_mask_input: torch.Tensor,
        orig_im_size: torch.Tensor,
    ) -> tuple[torch.Tensor, torch.Tensor, torch.Tensor]:
        unused = 0 * (point_labels.sum() + mask_input.sum() + has_mask_input.sum())  # they stay inputs of the file
        box = torch.cat([point_coords[:, 0], point_coords[:, 1]], dim=-1)[None] + unused
        out = self.sam(image_embeddings=image_embeddings, input_boxes=box, multimask_output=False)
        masks = torch.nn.functional.interpolate(out.pred_masks[0], (self.side, self.side), mode="bilinear")
        height, width = torch.floor(orig_im_size * (self.side / orig_im_size.max()) + 0.5).to(torch.int64)
        size = orig_im_size.to(torch.int64)
        masks = torch.nn.functional.interpolate(masks[..., :height, :width], (size[0], size[1]), mode="bilinear")
        return masks, out.iou_scores[0], out.pred_masks[0]


def sam() -> Any:
    """A tiny SAM (the first one), whose prompts and masks MobileSAM shares."""
    torch.manual_seed(0)
    vision = {"hidden_size": 32, "output_channels": 32, "num_hidden_layers": 1, "num_attention_heads": 2, "image_size": 128, "patch_size": 16, "window_size": 4, "global_attn_indexes": [0], "mlp_dim": 64, "num_pos_feats": 16}  # fmt: skip  # noqa: E501
    prompt = {"hidden_size": 32, "image_size": 128, "patch_size": 16}
    mask = {"hidden_size": 32, "mlp_dim": 64, "iou_head_hidden_dim": 32}
    return transformers.SamModel(
        transformers.SamConfig(vision_config=vision, prompt_encoder_config=prompt, mask_decoder_config=mask)
    ).eval()


def mobile_sam_onnx(folder: Path) -> Path:
    """``sam()`` as the two ONNX files that MobileSAM's scripts write."""
    folder.mkdir(parents=True, exist_ok=True)
    model = sam()
    names = ["image_embeddings", "point_coords", "point_labels", "mask_input", "has_mask_input", "orig_im_size"]
    box = torch.tensor([[[10.0, 10.0], [60.0, 70.0]]])
    inputs = (
        torch.randn(1, 32, 8, 8),
        box,
        torch.tensor([[2.0, 3.0]]),
        torch.zeros(1, 1, 32, 32),
        torch.zeros(1),
        torch.tensor([100.0, 120.0]),
    )
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")  # of tracing
        torch.onnx.export(
            _SamEncoder(model),
            (torch.randn(1, 3, 128, 128),),
            folder / "encoder.onnx",
            input_names=["image"],
            output_names=["image_embeddings"],
            dynamo=False,
        )
        torch.onnx.export(
            _SamDecoder(model),
            inputs,
            folder / "decoder.onnx",
            input_names=names,
            output_names=["masks", "iou_predictions", "low_res_masks"],
            dynamo=False,
        )
    return folder


def depth_anything(folder: Path, *, kind: str = "metric") -> Path:
    """A Depth Anything whose pictures have a shorter side of 56 pixels; ``kind``: "metric" or "relative"."""
    torch.manual_seed(0)
    backbone = transformers.Dinov2Config(
        image_size=56,
        patch_size=14,
        hidden_size=32,
        num_hidden_layers=4,
        num_attention_heads=2,
        out_indices=[1, 2, 3, 4],
        reshape_hidden_states=False,
    )
    config = transformers.DepthAnythingConfig(
        backbone_config=backbone,
        reassemble_hidden_size=32,
        neck_hidden_sizes=[8, 16, 32, 32],
        fusion_hidden_size=16,
        head_hidden_size=8,
        depth_estimation_type=kind,
        max_depth=20 if kind == "metric" else 1,
    )
    images = DPTImageProcessorPil(
        size={"height": 56, "width": 56},
        keep_aspect_ratio=True,
        ensure_multiple_of=14,
        resample=3,
        image_mean=[0.485, 0.456, 0.406],
        image_std=[0.229, 0.224, 0.225],
    )
    model = transformers.DepthAnythingForDepthEstimation(config)
    for name, weight in model.named_parameters():
        if weight.ndim == 4 and name.startswith(("neck", "head")):
            torch.nn.init.kaiming_normal_(weight)  # the library's own are so small that all depths are the same
    model.head.conv3.weight.data *= 0.03  # and its sigmoid isn't saturated
    return saved(model, folder, images)


class _DepthOnly(torch.nn.Module):
    def __init__(self, model: Any) -> None:
        super().__init__()
        self.model = model

    def forward(self, pixel_values: torch.Tensor) -> torch.Tensor:
        return self.model(pixel_values=pixel_values).predicted_depth


def depth_anything_onnx(folder: Path, *, height: int = 56, width: int = 70) -> Path:
    """``depth_anything`` as an ONNX file for pictures of one size."""
    model = transformers.DepthAnythingForDepthEstimation.from_pretrained(depth_anything(folder)).eval()
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")  # of tracing
        torch.onnx.export(
            _DepthOnly(model),
            (torch.randn(1, 3, height, width),),
            folder / "depth.onnx",
            input_names=["pixel_values"],
            output_names=["predicted_depth"],
            dynamo=False,
        )
    return folder / "depth.onnx"
