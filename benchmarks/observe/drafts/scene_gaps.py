import sys, time, json, numpy as np
pass
from concurrent.futures import ProcessPoolExecutor
from benchmarks.checkers.scene_painter import scene
from registration.inspection import ExpectedLines, see_layer, surface_of, SeeingOptions
from registration.files.readers.heights import HeightMap
from registration.errors import PictureError
class Fr:
    def __init__(s,f): s.f=f
    def to_pixels(s,p): return np.asarray(s.f(np.asarray(p,float)),float)
def see(S,kind):
    e=S.expected; n=len(e['width_mm'])
    lines=ExpectedLines(e['start'].astype(float),e['end'].astype(float),e['width_mm'].astype(float),np.arange(n),e['stroke'].astype(np.int64),e['fresh'].astype(bool))
    if kind=='laser':
        o=S.to_pixels(np.array([[0,0,0],[1,0,0],[0,1,0.]])); px=1/(o[1,0]-o[0,0])
        t=e['thickness_mm']; top=lines.end[lines.fresh,2].max()
        hm=HeightMap(np.asarray(S.picture,np.float32),(px,px),(-o[0,0]*px,-o[0,1]*px))
        s=surface_of(hm,np.eye(4),top-t/2,t,lines)
        return see_layer(s.picture,s.frame,lines,hidden=s.hidden,thickness_mm=t)
    return see_layer(S.picture,Fr(S.to_pixels),lines,before=S.before,options=SeeingOptions(round_lines=kind=='embedded'))
def job(a):
    kind,ink,seed,faulty=a
    rng=np.random.default_rng((seed,["single","stack","embedded","laser"].index(kind),["pale","dark","dyed","clear","milky"].index(ink)))
    faults={'gaps':[0.25,0.5,1.0]} if faulty else {}
    S=scene(kind,ink,rng,faults)
    t=time.process_time()
    try: f=see(S,kind)
    except Exception as x: return (*a,0,0,0,0,0.0,0.0,repr(x)[:90])
    t=time.process_time()-t
    hits=silent=0; st=f.stations; asks=0
    for s,b,e in S.truth['gaps']:
        hit=any(g.stroke==s and g.from_mm<e and g.to_mm>b for g in f.gaps)
        half=.5*st.length_mm
        own=(st.stroke==s)&(st.along_mm>b-half)&(st.along_mm<e+half)
        hits+=hit; silent+= not hit and bool(own.any() and st.seen[own].all())
    false=sum(not any(s==g.stroke and g.from_mm<e+.1 and g.to_mm>b-.1 for s,b,e in S.truth['gaps']) for g in f.gaps)
    sh=S.truth['shift']
    return (*a,len(S.truth['gaps']),hits,silent,false,f.seen_share,t,f"shift err {np.hypot(f.shift.dx_mm-sh[0],f.shift.dy_mm-sh[1]):.3f} ratio {f.width_ratio:.3f} u {f.u_width_ratio:.3f} flow {S.truth['flow']}")
if __name__=="__main__":
    n=int(sys.argv[1]); kinds=sys.argv[2].split(',')
    jobs=[(k,i,s,s%2==1) for k in kinds for i in ("pale","dark","dyed","clear","milky") for s in range(n)]
    with ProcessPoolExecutor(2) as p: R=list(p.map(job,jobs))
    for r in R:
        if len(sys.argv)>3: print(r)
    for k in kinds:
        for i in ("pale","dark","dyed","clear","milky"):
            q=[r for r in R if r[0]==k and r[1]==i]
            print(f"{k:9s} {i:6s} planted {sum(r[4] for r in q):3d} hits {sum(r[5] for r in q):3d} silent {sum(r[6] for r in q):3d} false {sum(r[7] for r in q):3d} seen {np.mean([r[8] for r in q]):.2f} s {np.mean([r[9] for r in q]):.2f}")
    print("TOTAL planted",sum(r[4] for r in R),"hits",sum(r[5] for r in R),"silent",sum(r[6] for r in R),"false",sum(r[7] for r in R))
