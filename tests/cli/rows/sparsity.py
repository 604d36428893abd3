"""Command lines of ``slamcli sparsity``."""

from __future__ import annotations

from row import BROKEN, ROW, SEEN, Case

ROWS = (
    Case(
        "sparsity {in}",
        0,
        out=("6 x 6, 21 nonzeros in the triangle", "nnz(L)", "natural", "amd *", "what --ordering auto"),
    ),
    Case("sparsity - --orderings amd,natural", 0, out="natural"),
    Case("sparsity {in} --orderings auto", 0, out="auto (amd)"),
    Case("sparsity {in} --orderings natural,rcm,colamd --json", 0, out=('"command": "sparsity"', '"name": "colamd"')),
    Case("sparsity {in} --time-limit 0 --json", 0, out=('"calibration": null', '"measured_time": null')),
    Case("sparsity {in} --fix 2 --time-limit 0", 0, out=("1 fixed by the file or by --fix: 2", "6 x 6")),
    Case("sparsity {in} --orderings amd-landmarks-first", 0, out=("reduced", "6 x 6", "1 landmark"), content=SEEN),
    Case("sparsity {in} --orderings amd --add-closure 2,3", 0, out=("blocks of", "appear"), content=ROW),
    Case("sparsity {in} --orderings amd --marginalize 2", 0, out=("blocks of", "appear"), content=ROW),
    Case("sparsity {in} --spy {out} --tree tree.svg --title Row --dpi 40", 2, err="--spy {out}"),
    Case(
        "sparsity {in} --spy spy.png --tree tree.svg --title Row --dpi 40", 0, out=("spy.png", "tree.svg"), content=ROW
    ),
    Case("sparsity {in} --spy a.png --tree a.png", 2, err="name the same file"),
    Case("sparsity {in} --spy - --json", 2, err="both want standard output"),
    Case("sparsity {in} --tree tree.txt", 2, err=("--tree tree.txt ends in .txt", ".svg")),
    Case("sparsity {in} --spy nowhere/spy.png --orderings amd", 3, err="nowhere/spy.png: cannot be written"),
    Case("sparsity {in} --orderings mmd", 2, err=("'mmd' does not exist", "colamd")),
    Case("sparsity {in} --orderings ,", 2, err="names no ordering"),
    Case("sparsity {in} --add-closure 1", 2, err="expected two ids"),
    Case("sparsity {in} --add-closure 1,1", 2, err="joins two variables"),
    Case("sparsity {in} --add-closure 1,77", 2, err=("--add-closure: no variable has the id 77", "SE2 0 to 2")),
    Case("sparsity {in} --marginalize 77", 2, err=("--marginalize: no variable has the id 77", "SE2 0 to 2")),
    Case("sparsity {in} --marginalize 0", 2, err="variable 0 is held"),
    Case("sparsity {in} --time-limit -1", 2, err="--time-limit"),
    Case("sparsity {in} --time-limit nan", 2, err="--time-limit must be a number"),
    Case("sparsity {in} --fix 0 --fix 1 --fix 2", 3, err="all variables are held"),
    Case("sparsity {in}", 3, err="no edge that slamcli can use", content="VERTEX_SE2 0 0 0 0\n"),
    Case("sparsity {in}", 3, err="{in}:5:16:", content=BROKEN),
    Case("sparsity {in} --lenient --dialect g2o --orderings amd", 0, err="skipped: {in}:5:16", content=BROKEN),
    Case("sparsity nowhere.g2o", 3, err="nowhere.g2o: cannot be read"),
    Case("sparsity --help", 0, out=("Usage: slamcli sparsity", "--add-closure", "Exit codes")),
)
