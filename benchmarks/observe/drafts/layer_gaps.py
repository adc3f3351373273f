import sys, time, numpy as np
from benchmarks.checkers import layer_painter as painter
from benchmarks.observe.seeing import expected, LENGTHS_MM, FIRST_FAULTY
from registration.inspection.pictures.picture import view_of
from registration.inspection.ink.learn import learned
from registration.inspection.options import SeeingOptions
from registration.inspection.ways import lay_ways
def run(seed, kind, layout, um, size, lengths):
    rng = np.random.default_rng(seed)
    plan = painter.plan_layer(layout, size, rng.uniform(0.2, 0.5), rng)
    look = painter.random_look(kind, rng, 0.3)
    gaps = painter.plant_gaps(plan, lengths, rng)
    ink = painter.lay(plan, rng, gaps=gaps)
    x, y = rng.uniform(-0.06, 0.06, 2)
    p = painter.paint(plan, ink, gaps, size, um, look, rng, tilt=15, shift=(x, y))
    lines=expected(plan); opt=SeeingOptions()
    ways=lay_ways(lines,opt.gap_mm/4)
    t=time.process_time()
    view,frame=view_of(p.picture,p.frame,ways,opt.gap_mm,())
    L=learned(view,frame,lines,ways,opt)
    return p,L,(x,y),time.process_time()-t

def job(a):
    k,kind=a
    um = (10.0, 20.0, 40.0)[k % 3]
    layout, size = painter.LAYOUTS[(k // 2) % 4], 4.0 if um < 15 else 6.0
    p,L,s,t=run(FIRST_FAULTY+k,kind,layout,um,size,LENGTHS_MM[k%3:])
    J=L.judged; b=J.states[:,2]; w=L.placed.ways; out=[]; inside=np.zeros(len(w),bool); hits=0
    for st,a,e in p.gaps:
        own=(w.stroke==st)&(w.along>a)&(w.along<e); inside|=(w.stroke==st)&(w.along>a-.1)&(w.along<e+.1)
        hit=own.any() and b[own].max()>.5; hits+=hit
        out.append(f"{e-a:.2f}:{b[own].max() if own.any() else -1:.2f}/{np.median(J.shares.share[own]):.2f}")
    f=np.flatnonzero((b>.5)&~inside)
    runs=np.split(f,np.flatnonzero(np.diff(f)>1)+1) if len(f) else []
    fl=[f"st{w.stroke[r[0]]} {w.along[r[0]]:.2f}+{len(r)} end{w.to_end[r].min():.2f} cr{int(L.placed.crossed[r].any())} sh{np.median(J.shares.share[r]):.2f}" for r in runs]
    m=J.noise
    txt=f"{k} {kind} {layout} {um} w{w.width[0]:.2f} {'odd' if L.odd else 'even'} shift {np.round(np.array([L.shift.dx_mm,L.shift.dy_mm])-s,3)} sf {m.full[0]:.3f} ub {np.median(J.shares.u_share):.3f} tie {m.tie:.2f} hid {(J.states[:,3]>.5).mean():.2f} {out} FALSE {fl} {t:.2f}s"
    return len(p.gaps),hits,len(runs),np.hypot(*(np.array([L.shift.dx_mm,L.shift.dy_mm])-s)),kind,txt
if __name__=="__main__":
    from concurrent.futures import ProcessPoolExecutor
    jobs=[(k,kind) for k in range(int(sys.argv[1]),int(sys.argv[2])) for kind in painter.KINDS]
    with ProcessPoolExecutor(2) as pool: R=list(pool.map(job,jobs))
    for r in R: print(r[-1])
    for kind in painter.KINDS:
        q=[r for r in R if r[4]==kind]
        print(kind,"planted",sum(r[0] for r in q),"hits",sum(r[1] for r in q),"false",sum(r[2] for r in q),"shift med/max",np.median([r[3] for r in q]).round(4),np.max([r[3] for r in q]).round(4))
