"""Bad input for every command: what is typed, and the words its one sentence must hold."""

from __future__ import annotations

from dataclasses import dataclass


@dataclass(frozen=True)
class Case:
    """One command line that must be refused; ``words`` name the file or argument, and the cause."""

    id: str
    line: str
    words: tuple[str, ...]


def _case(id_: str, line: str, *words: str) -> Case:
    return Case(id_, line, words)


def _pool(folder: str, *words: str) -> Case:
    return _case(
        f"pool-{folder}", f"evaluate {folder} --uniform -b pairs -r pairs --store new.sqlite", *words
    )


def _pairs(folder: str, *words: str) -> Case:
    line = f"search pool -b pairs -r {folder} -o new/run --json"
    return _case(f"pairs-{folder}", line, *words)


def _evaluate(id_: str, rest: str, *words: str) -> Case:
    return _case(f"evaluate-{id_}", f"evaluate pool {_usual(rest)} {rest}", *words)


def _usual(rest: str) -> str:
    """Benchmark and store, where a case names no other: each is said once."""
    usual = "" if "-b " in rest else "-b pairs -r pairs"
    return usual if "--store" in rest else f"{usual} --store new/s.sqlite"


def _baselines(id_: str, rest: str, *words: str) -> Case:
    return _case(f"baselines-{id_}", f"baselines pool {_usual(rest)} {rest}", *words)


def _search(id_: str, rest: str, *words: str) -> Case:
    return _case(f"search-{id_}", f"search pool -b pairs -r pairs -o new {rest}", *words)


def _merge(id_: str, rest: str, *words: str) -> Case:
    return _case(f"merge-{id_}", f"merge pool {rest}", *words)


def _predict(id_: str, rest: str, *words: str) -> Case:
    return _case(f"predict-{id_}", f"predict {rest}", *words)


LEFT, RIGHT = "pairs/pair0/left.png", "pairs/pair0/right.png"
PAIR = f"-l {LEFT} -r {RIGHT}"

POOLS = (
    _pool("truncated", "truncated/a.safetensors", "whole file"),
    _pool("truncated-torch", "truncated-torch/a.pth", "whole torch file"),
    _pool("empty", "empty/a.safetensors", "cannot be read"),
    _pool("pickled", "pickled/a.pth", "code sfkit does not run", "sqlite3.Row"),
    _pool("no-state", "no-state/a.pth", "epoch, loss", "state dict"),
    _pool("wrong-key", "wrong-key/a.safetensors", "feature_extraction.block0.0.0.weight", "missing"),
    _pool("extra-key", "extra-key/a.safetensors", "decoder.weight", "does not have"),
    _pool("wrong-shape", "wrong-shape/a.safetensors", "feature_extraction.block0.0.0.weight", "shape"),
    _pool("nan", "nan/a.safetensors", "feature_extraction.block0.0.0.weight", "not finite"),
    _pool("twins", "twins/b.safetensors", "'driving'", "'kitti'", "same content"),
    _pool("absent", "absent/a.safetensors", "no such file", "did you mean 'a_.safetensors'"),
    _pool("no-base", "no-base/base.safetensors", "no such file"),
    _pool("wrong-ending", "a.onnx", "no such file"),
    _pool("bad-toml", "bad-toml/pool.toml", "not TOML"),
    _pool("unknown-key", "unknown-key/pool.toml", "'fiel'", "did you mean 'file'"),
    _pool("unknown-table", "unknown-table/pool.toml", "'optoins'", "did you mean 'options'"),
    _pool("leaves-root", "leaves-root/pool.toml", "../outside.safetensors", "leaves the root"),
    _pool("absolute", "absolute/pool.toml", "outside.safetensors", "leaves the root"),
    _pool("no-variable", "no-variable/pool.toml", "SFKIT_NOT_SET", "not set"),
    _pool("architecture", "architecture", "'anynnet'", "did you mean 'anynet'"),
    _pool("option", "option", "'snp'", "did you mean 'spn'"),
    _pool("blocks", "blocks", "block 'all'", "feature_extration.*", "matches no parameter"),
    _pool("no-sources", "no-sources/pool.toml", "[sources]", "missing"),
    _pool("nowhere", "nowhere", "no such file"),
    _pool("nothing", "nothing/pool.toml", "no such file"),
    _pool("garbage.sqlite", "garbage.sqlite", "not TOML"),
)

PAIRS = (
    _pairs("unequal", "unequal/pair0/right.png", "96x40", "96x48"),
    _pairs("deep-image", "deep-image/pair0/left.png", "uint16", "8-bit"),
    _pairs("invalid", "invalid/pair0/disparity.pfm", "no valid pixel"),
    _pairs("other-size", "other-size/pair0/disparity.pfm", "48x24", "96x48"),
    _pairs("cut-truth", "cut-truth/pair0/disparity.pfm", "cut off"),
    _pairs("cut-image", "cut-image/pair0/left.png", "ends too early"),
    _pairs("eight-bit", "eight-bit/pair0/disparity.png", "8-bit image", "16 bits"),
    _pairs("no-coding", "no-coding/pair0/disparity.png", "no coding"),
    _pairs("bad-hint", "bad-hint/pair0/pairs.toml", "'codign'", "did you mean 'coding'"),
    _pairs("no-truth", "no-truth", "pair0: the right file"),
    _pairs("nothing", "nothing", "no pair"),
    _pairs("missing-folder", "missing-folder", "no such folder"),
    _case(
        "pairs-column", "search pool -b pairs -r pairs --csv column.csv -o new", "'disparty'", "'disparity'"
    ),
    _case("pairs-absent", "search pool -b pairs -r pairs --csv absent.csv -o new", "absent.csv", "rigth.png"),
    _case("pairs-leaves", "search pool -b pairs -r pairs --csv leaves.csv -o new", "../unequal", "under"),
    _case("pairs-no-row", "search pool -b pairs -r pairs --csv no-row.csv -o new", "no-row.csv", "no row"),
    _case("no-mask", "search pool -b eth3d -r eth3d -o new", "openstereo", "mask0nocc.png", "raft"),
    _case("no-root", "search pool -b eth3d -o new", "--root", "missing"),
    _case("benchmark", "search pool -b eth3 -r eth3d -o new", "'eth3'", "did you mean 'eth3d'"),
    _case("wrong-root", "search pool -b kitti2012 -r eth3d -o new", "kitti2012", "eth3d", "no pair"),
    _case(
        "protocol", "search pool -b pairs -r pairs --protocol rafts -o new", "'rafts'", "did you mean 'raft'"
    ),
    _case("protocol-of-family", "search pool -b pairs -r pairs --protocol raft -o new", "'raft'", "'pairs'"),
    _case("metric", "search pool -b pairs -r pairs --metric bad1.o -o new", "'bad1.o'", "did you mean"),
    _case("threshold", "search pool -b pairs -r pairs --metric bad-0 -o new", "'bad-0'", "more than 0"),
    _case("resolution", "search pool -b pairs -r pairs --resolution H -o new", "resolution", "'H'"),
    _case("coding", "search pool -b pairs -r no-coding --coding png15 -o new", "'png15'", "png16"),
)

EVALUATE = (
    _evaluate("nothing", "", "--subset", "--recipe"),
    _evaluate("source", "--subset kiti,driving", "'kiti'", "did you mean 'kitti'"),
    _evaluate("empty", "--subset ,", "--subset", "empty"),
    _evaluate("twice", "--subset kitti,kitti", "kitti", "twice"),
    _evaluate("no-recipe", "--recipe nowhere.json", "nowhere.json", "no such file"),
    _evaluate("other-pool", "--recipe other-pool.json", "other-pool.json", "'sintel'"),
    _evaluate("other-blocks", "--recipe other-blocks.json", "other-blocks.json", "blocks"),
    _evaluate("not-json", "--recipe not-json.json", "not-json.json", "not JSON"),
    _evaluate("list", "--recipe list.json", "list.json", "expected a table"),
    _evaluate("no-format", "--recipe no-format.json", "no-format.json", "format"),
    _evaluate("lacking", "--recipe lacking.json", "lacking.json", "'scales'", "missing"),
    _evaluate("malformed", "--recipe malformed.json", "malformed.json", "weights", "expected a table"),
    _evaluate("nan", "--recipe nan.json", "nan.json", "nan", "NaN"),
    _evaluate("no-step", "--recipe no-step.json", "no-step.json", "'elekt'", "did you mean 'elect'"),
    _evaluate("step-source", "--members --recipe step-source.json", "step-source.json", "'kiti'"),
    _evaluate("step-name", "--members --recipe step-name.json", "step-name.json", "'ties'", "other"),
    _evaluate("step-fisher", "--recipe step-fisher.json", "step-fisher.json", "eth3d", "measure it again"),
    _evaluate("bare", "--recipe outside.safetensors", "outside.safetensors", "carries no recipe"),
    _evaluate("edited", "--recipe edited-json.safetensors", "edited-json.safetensors", "edited"),
    _evaluate("device", "--uniform --device cuda:77", "cuda:77", "not there"),
    _evaluate("device-name", "--uniform --device gpu", "'gpu'", "cuda"),
    _evaluate("engine", "--uniform --engine inlien", "engine", "'inlien'", "did you mean 'inline'"),
    _evaluate("workers", "--uniform --workers 0", "workers", "0"),
    _evaluate("out-ending", "--uniform -o scores.txt", "scores.txt", ".csv"),
    _evaluate("out-exists", "--uniform -o scores.csv", "scores.csv", "exists", "--force"),
    _evaluate("out-under-file", "--uniform -o scores.csv/new.csv", "scores.csv", "is a file"),
    _evaluate("store-garbage", "--uniform --store garbage.sqlite", "garbage.sqlite", "not a database"),
    _evaluate("store-other", "--uniform --store other.sqlite", "other.sqlite", "no evaluation store"),
    _evaluate("store-folder", "--uniform --store pairs", "pairs", "is a folder"),
    _evaluate("option", "--unifrom", "--unifrom", "--uniform"),
    _evaluate("mask", "--uniform --protocol openstereo -b eth3d -r eth3d", "openstereo", "mask0nocc.png"),
)

BASELINES = (
    _baselines("name", "--names unifrom", "'unifrom'", "did you mean 'uniform'"),
    _baselines("name-after-others", "--names uniform,tise", "'tise'", "did you mean 'ties'"),
    _baselines("no-names", "--names ,", "--names", "empty"),
    _baselines("combine", "--also pairs,root=pairs --combine median", "--combine", "'median'", "worst"),
    _baselines("oracle", "--names uniform,single_best_oracle", "'single_best_oracle'", "sfkit report"),
    _baselines("seed", "--seed -1", "seed", "-1"),
    _baselines("population", "--population 1", "population", "1", "at least 2"),
    _baselines("evaluations", "--evaluations 0", "evaluations", "0", "at least 1"),
    _baselines("metric", "--metric bad1.o", "'bad1.o'", "did you mean"),
    _baselines("out-exists", "--names uniform -o scores.csv", "scores.csv", "exists", "--force"),
    _baselines("store-garbage", "--store garbage.sqlite", "garbage.sqlite", "not a database"),
)

SEARCH = (
    _search("population", "--population 0", "population", "0", "at least 2"),
    _search("population-text", "--population many", "--population", "a whole number"),
    _search("generations", "--generations -1", "generations", "-1", "at least 0"),
    _search("evaluations", "--evaluations -1", "evaluations", "-1", "at least 1"),
    _search("nothing", "--subset kitti,driving --evaluations 0", "subset", "Stage 2"),
    _search("batch", "--method bayesian --batch 0", "batch", "0", "at least 1"),
    _search("batch-paper", "--batch 4", "--batch", "--method paper", "--method bayesian"),
    _search("beta-paper", "--stage2-beta 2", "--stage2-beta", "--method paper", "--method bayesian"),
    _search("crossover", "--method bayesian --crossover 0.8", "--crossover", "--method bayesian"),
    _search("no-redraw", "--method bayesian --no-redraw", "--no-redraw", "--method bayesian"),
    _search("tolx", "--method bayesian --tolx 1e-9", "--tolx", "--method bayesian", "--method paper"),
    _search("left-out", "--subset kitti,driving --mutation 0.5", "--mutation", "--subset", "Stage 1"),
    _search("combine-one", "--combine worst", "--combine", "one benchmark", "--also"),
    _search("seed", "--seed -4", "seed", "-4"),
    _search("entropy", "--entropy nan", "entropy", "nan"),
    _search("holdout", "--holdout 1.5", "holdout", "1.5", "folds"),
    _search("shrinkage", "--shrinkage -1", "shrinkage", "-1", "at least 0"),
    _search("rank", "--rank 0", "rank", "0", "at least 1"),
    _search("rank-tied", "--rank x", "--rank", "a whole number"),
    _search("also", "--also pair,root=pairs", "'pair'"),
    _search("also-entry", "--also pairs,pairs", "--also", "'pairs'", "KEY=VALUE"),
    _search("also-root", "--also pairs", "root", "missing"),
    _search("also-key", "--also pairs,rot=pairs", "'rot'", "did you mean 'root'"),
    _search("combine", "--also pairs,root=pairs --combine median", "--combine", "'median'", "worst"),
    _search("blocks", "--blocks modul", "'modul'", "did you mean 'modules'"),
    _search("largest", "--largest 1", "largest", "1"),
    _search("one-source", "--subset kitti", "kitti", "at least two"),
    _search("source", "--subset kitti,drivin", "'drivin'", "did you mean 'driving'"),
    _search("include", "--include indor", "include", "'indor'", "did you mean 'indoor'"),
    _search("both", "--include kitti --exclude kitti", "include", "'kitti'", "exclude"),
    _search("exclude", "--exclude kitti,driving", "sources", "found 1", "at least 2"),
    _search("block", "--frozen bakbone", "frozen_blocks", "'bakbone'", "did you mean 'backbone'"),
    _search("start-alone", "--start good.json", "start", "subset"),
    _search("start-scale", "--subset kitti,driving --start strong.json", "start", "scale 2"),
    _search("start-missing", "--subset kitti,driving --start nowhere.json", "nowhere.json", "no such file"),
    _search("two-subsets", "--subset kitti,driving --subset-from good.json", "--subset-from"),
    _search("subset-from", "--subset-from other-pool.json", "'sintel'"),
    _case("search-one", "search one-source -b pairs -r pairs -o new", "sources", "found 1", "at least 2"),
    _case("search-out", "search pool -b pairs -r pairs -o scores.csv", "scores.csv", "is a file"),
    _case("search-kept", "search pool -b pairs -r pairs -o kept", "kept/merged.safetensors", "exists"),
    _case("search-store", "search pool -b pairs -r pairs -o new --store garbage.sqlite", "garbage.sqlite"),
)

MERGE = (
    _merge("nothing", "-o new.safetensors", "exactly one", "--subset", "found 0"),
    _merge("two", "--uniform --subset kitti -o new.safetensors", "exactly one", "found 2"),
    _merge("no-sign", "--weights kitti -o new.safetensors", "--weights", "'kitti'", "NAME=NUMBER"),
    _merge("no-number", "--weights kitti=much -o new.safetensors", "--weights", "'kitti=much'"),
    _merge("negative", "--weights kitti=-1 -o new.safetensors", "--weights", "'kitti=-1'", "at least 0"),
    _merge("weight-twice", "--weights kitti=1,kitti=2 -o new.safetensors", "--weights", "more than once"),
    _merge("weight-name", "--weights kiti=1 -o new.safetensors", "'kiti'", "did you mean 'kitti'"),
    _merge("no-weights", "--weights , -o new.safetensors", "--weights", "empty"),
    _merge("step-name", "--recipe step-name.json -o new.safetensors", "step-name.json", "'ties'", "other"),
    _merge("step-fisher", "--recipe step-fisher.json -o new.safetensors", "step-fisher.json", "measured"),
    _merge("exists", "--uniform -o merged.safetensors", "merged.safetensors", "exists", "--force"),
    _merge("member", "--uniform -o pool/a.safetensors --force", "pool/a.safetensors", "'kitti'"),
    _merge("ending", "--uniform -o new.pth", "new.pth", ".safetensors"),
    _merge("form", "--uniform -o new.pth --form orginal", "--form", "orginal"),
    _merge("folder", "--uniform -o folder.safetensors --force", "folder.safetensors", "is a folder"),
    _merge("under-file", "--uniform -o scores.csv/deep/new.safetensors", "scores.csv", "no folder"),
)

PREDICT = (
    _predict("left", f"merged.safetensors -l lfet.png -r {RIGHT} -o new", "lfet.png", "no such file"),
    _predict("unequal", f"merged.safetensors -l {LEFT} -r unequal/pair0/right.png -o new", "96x40", "96x48"),
    _predict("kinds", f"merged.safetensors -l three -r {RIGHT} -o new", "three", "a folder"),
    _predict("counts", "merged.safetensors -l three -r pairs/pair0 -o new", "three", "3 and 2 images"),
    _predict("no-images", "merged.safetensors -l nothing -r nothing -o new", "nothing", "one and the same"),
    _predict("deep", f"merged.safetensors -l deep-image/pair0/left.png -r {RIGHT} -o new", "uint16"),
    _predict("cut", f"merged.safetensors -l cut-image/pair0/left.png -r {RIGHT} -o new", "ends too early"),
    _predict("baseline", f"merged.safetensors {PAIR} --focal 700 -o new", "--baseline", "missing"),
    _predict("focal", f"merged.safetensors {PAIR} --focal 0 --baseline 0.5 -o new", "--focal", "above 0"),
    _predict("calibration", f"merged.safetensors {PAIR} --calib calib.txt -o new", "calib.txt", "'baseline'"),
    _predict("both", f"merged.safetensors {PAIR} --calib calib.txt --focal 7 -o new", "--calib", "not both"),
    _predict("form", f"merged.safetensors {PAIR} --form png8 -o new", "'png8'", "did you mean 'png16'"),
    _predict("exists", f"merged.safetensors {PAIR} -o earlier", "earlier/left.pfm", "exists"),
    _predict(
        "image", f"merged.safetensors {PAIR} --form png16 -o pairs/pair0 --force", LEFT, "one of the images"
    ),
    _predict("no-right", f"merged.safetensors -l {LEFT} -o new", "--right is missing"),
    _predict("layout", f"merged.safetensors {PAIR} --layout side-by-side -o new", "layout 'side-by-side'"),
    _predict("layout-name", f"merged.safetensors -l {LEFT} --layout sbs -o new", "'sbs'", "side-by-side"),
    _predict("no-video", "merged.safetensors -l calib.mp4 -r three -o new", "calib.mp4", "no such file"),
    _predict("not-a-video", "merged.safetensors -l no.mp4 --layout top-bottom -o new", "no.mp4", "video"),
    _predict("every", f"merged.safetensors {PAIR} --every 2 -o new", "--every is 2", "no video"),
    _predict("cameras", f"merged.safetensors {PAIR} --cameras 2,3 -o new", "--cameras", "no --calib"),
    _predict("cameras-form", f"merged.safetensors {PAIR} --calib calib.txt --cameras 2 -o new", "'2'", "2,3"),
    _predict("cloud", f"merged.safetensors {PAIR} --cloud -o new", "point cloud", "no calibration"),
    _predict(
        "centre",
        f"merged.safetensors {PAIR} --focal 7 --baseline 1 --cloud -o new",
        "principal point",
        "K.txt",
    ),
    _predict(
        "size", f"merged.safetensors {PAIR} --calib sized.txt -o new", "941x490 pixels, found 96x48", "K.txt"
    ),
    _predict("device", f"merged.safetensors {PAIR} --device gpu -o new", "'gpu'", "expected cpu"),
    _predict("out", f"merged.safetensors {PAIR} -o scores.csv/new", "scores.csv", "no folder"),
    _predict("unknown", f"outside.safetensors {PAIR} -o new", "outside.safetensors", "architecture"),
    _predict("name", f"outside.safetensors {PAIR} -o new --architecture anynt", "'anynt'", "'anynet'"),
    _predict(
        "options", f"outside.safetensors {PAIR} -o new --architecture anynet", "outside.safetensors", "key"
    ),
    _predict("option", f"merged.safetensors {PAIR} -o new --option spn", "--option", "'spn'"),
    _predict("infinite", f"infinite.safetensors {PAIR} -o new", "infinite.safetensors", "not finite"),
    _predict("edited", f"edited-form.safetensors {PAIR} -o new", "edited-form.safetensors", "architecture"),
)

OTHERS = (
    _case("show-missing", "show nowhere.pth", "nowhere.pth", "no such file"),
    _case("show-ending", "show calib.txt", "calib.txt", "'.txt'"),
    _case("show-garbage", "show garbage.sqlite", "garbage.sqlite", "not a database"),
    _case("show-empty", "show empty.sqlite", "empty.sqlite", "is empty"),
    _case("show-edited", "show edited-member.safetensors", "edited-member.safetensors", "base", "licence"),
    _case("show-lacks", "show lacks-entries.safetensors", "lacks-entries.safetensors", "pool"),
    _case("show-recipe", "show list.json", "list.json", "JSON list"),
    _case("check-root", "data check eth3d", "--root", "missing"),
    _case("check-name", "data check midlebury -r eth3d", "'midlebury'", "did you mean 'middlebury'"),
    _case("check-folder", "data check eth3d -r nowhere", "nowhere", "no such folder"),
    _case("check-resolution", "data check middlebury -r eth3d --resolution X", "'X'"),
    _case("report-notebook", "report nowhere.ipynb -o new.html", "nowhere.ipynb", "cannot be read"),
    _case("report-broken", "report broken.ipynb -o new.html", "broken.ipynb", "notebook"),
    _case("report-parameter", "report book.ipynb -p sede 1 -o new.html", "'sede'", "did you mean 'seed'"),
    _case("report-kind", "report book.ipynb -p seed one -o new.html", "book.ipynb", "'seed'", "number"),
    _case("report-value", "report book.ipynb -o new.html -p", "-p"),
    _case("report-ending", "report book.ipynb -o new.pdf", "new.pdf", ".html"),
    _case("report-place", "report book.ipynb -o scores.csv/new.html", "scores.csv"),
    _case("command", "evalute pool", "'evalute'", "did you mean 'evaluate'"),
    _case("subcommand", "data chek", "'chek'", "did you mean 'check'"),
    _case("no-argument", "show", "argument", "file"),
    _case("option", "--verison", "--verison", "--version"),
)

CASES = (*POOLS, *PAIRS, *EVALUATE, *BASELINES, *SEARCH, *MERGE, *PREDICT, *OTHERS)
