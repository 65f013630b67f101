!> Work space of the implicit method: per body what the structured Newton matrix needs, and the rows that bodies meet in -
!> constraints, and soft rows for what springs, loads and curved joints do between places. Nothing here runs in a step.
module implicit_model
  use kinds, only: wp, ip
  use banded, only: band_factor
  use generalized_alpha, only: alpha_method, alpha_step
  use implicit_element, only: element_arrays, set_up_elements
  use implicit_row_lists, only: list_rows, order_rows
  use implicit_rows, only: row_system
  use mechanism, only: mechanism_model
  use ordering, only: reverse_cuthill_mckee
  implicit none (type, external)
  private
  public :: implicit_body, ghm_term, implicit_solver, set_up_implicit

  !> One body's share.
  type :: implicit_body
    integer :: nf = 0
    type(element_arrays) :: el               !! nodal bodies
    real(wp), allocatable :: x(:)            !! (0:nf) gather buffer
    real(wp), allocatable :: ff(:)           !! (0:nf) elastic residual, then B^-1 of it
    real(wp), allocatable :: col(:)          !! (0:nf) column of the frame's angle, then B^-1 of it
    real(wp), allocatable :: row(:)          !! (0:nf) row of the frame's angle
    ! the elastic block B
    type(band_factor) :: base                !! nodal: factor of the constant block
    integer :: entries = 0                   !! nodal: of its lower triangle
    integer, allocatable :: rows(:), cols(:) !! (entries) where
    real(wp), allocatable :: values(:)       !! (entries) [kg/s2], [kg m/s2] or [kg m2/s2]
    integer, allocatable :: reordered(:)     !! (nf) reordered row of each coordinate
    real(wp), allocatable :: band(:)         !! work of its factorisation
    integer :: kb = 0                        !! nodal: half band width of the exact block
    integer, allocatable :: position(:)      !! (nf) its ordering
    real(wp), allocatable :: lu(:, :)        !! its LU (LAPACK band storage), or the dense LU of a modal body
    real(wp), allocatable :: dense(:, :)     !! modal: LU of the constant block
    real(wp), allocatable :: stiff(:, :)     !! modal: K_eff
    real(wp), allocatable :: hm(:)           !! (nf) modal: GHM history force
    integer, allocatable :: pivots(:)        !! (nf) of lu
    integer, allocatable :: base_pivots(:)   !! (nf) of dense
    real(wp), allocatable :: many(:, :)      !! (nf, 2 + nc) right-hand sides of one solve
    ! places where rows act
    integer :: na = 0                        !! such places
    integer, allocatable :: place(:)         !! (na)
    integer, allocatable :: column(:, :)     !! (3, na) column of E_k^T, 0: none
    integer, allocatable :: seat(:, :)       !! (2, nc) place and component of each column
    logical :: exact_columns = .false.       !! xs, xe and their products were solved with the exact block
    real(wp), allocatable :: xs(:, :)        !! (nf, 2) B^-1 S-bar^T
    real(wp), allocatable :: xe(:, :)        !! (nf, nc) B^-1 E^T
    real(wp), allocatable :: compliance(:, :, :, :)   !! (3, 3, na, na) E_i B^-1 E_j^T
    real(wp), allocatable :: exs(:, :, :)    !! (3, 2, na) E_k B^-1 S-bar^T
    real(wp), allocatable :: exy(:, :)       !! (3, na) E_k B^-1 col
    real(wp), allocatable :: exf(:, :)       !! (3, na) E_k B^-1 ff
    real(wp), allocatable :: sxe(:, :)       !! (2, nc) S-bar B^-1 E^T
    real(wp), allocatable :: rxe(:)          !! (nc) row B^-1 E^T
    real(wp), allocatable :: load(:)         !! (nc) forces of the rows on the columns
    real(wp) :: pss(2, 2) = 0.0_wp           !! S-bar B^-1 S-bar^T
    ! frame
    real(wp) :: trr(3, 3) = 0.0_wp           !! tangent of the frame (body axes), then condensed
    real(wp) :: minv(3, 3) = 0.0_wp          !! inverse of the condensed tangent
    real(wp) :: k1 = 0.0_wp, k2 = 0.0_wp     !! row of the origin: (k1 + k2 H) S-bar
    real(wp) :: rr(3) = 0.0_wp               !! residual of the frame, then condensed
    real(wp) :: d0(3) = 0.0_wp               !! frame's correction without rows
  end type implicit_body

  !> One GHM term of one run of elements, of one material of a modal body, or of one spring.
  type :: ghm_term
    integer :: o = 0                         !! offset of its coordinates among all dissipative ones, from 0
    integer :: n = 0                         !! how many
    integer :: body = 0, run = 0             !! whose, or
    integer :: spring = 0
    real(wp) :: alpha = 0.0_wp, two_zw = 0.0_wp, w2 = 0.0_wp   !! [-], [1/s], [1/s2]
    real(wp) :: dinv = 0.0_wp                !! 1/(d1 + 2 zeta omega h gamma + omega2 h2 beta) [-]
    real(wp) :: g = 0.0_wp                   !! dz/d(deformation) [-]
  end type ghm_term

  !> The method with its state and work space.
  type :: implicit_solver
    type(alpha_method) :: method
    type(alpha_step) :: now                  !! coefficients of the step that the factors stand for
    type(implicit_body), allocatable :: b(:)
    type(row_system) :: rows
    type(ghm_term), allocatable :: terms(:)
    ! state at the end of the last step
    real(wp), allocatable :: q(:), v(:), vd(:), a(:)      !! (nq) v is off the manifold by the method's own O(h2)
    real(wp), allocatable :: z(:), zd(:), zdd(:), az(:)   !! (nz)
    real(wp), allocatable :: lambda(:)       !! (rows)
    real(wp) :: dissipated = 0.0_wp, work = 0.0_wp        !! [J]
    real(wp) :: power = 0.0_wp, input = 0.0_wp            !! [W]
    real(wp) :: removed = 0.0_wp             !! energy that the method itself took [J]
    logical :: tight = .true.                !! errors are estimated from accelerations of the equations, not the method's own
    integer :: agreed = 0                    !! steps since both estimates last differed
    real(wp) :: firm = 1.0_wp                !! rows%weakest where the method's own took over [-]
    real(wp), allocatable :: acceleration(:), acceleration1(:)   !! (nq + nz) these at the ends of the step
    real(wp), allocatable :: before(:)       !! (nq + nz) their change in the step before
    real(wp), allocatable :: before_own(:)   !! (nq) the same of the method's own accelerations
    real(wp), allocatable :: change(:)       !! (nq) work of the start and of the error estimate
    real(wp), allocatable :: old(:, :)       !! (nz, 4) z, z', z'', az at the start of a step that is being judged
    real(wp) :: h_before = 0.0_wp            !! and its size [s], 0: none
    integer :: exact_left = 0                !! steps that still use the exact block
    ! the trial step
    logical :: ended = .false.               !! its dissipative coordinates have replaced those of its start
    real(wp), allocatable :: q1(:), v1(:), vd1(:), lambda1(:), dq(:)   !! [m, rad], their rates, [N] and a correction
    real(wp), allocatable :: pre(:), zk(:)   !! (nz) what the past adds to az, z
    real(wp), allocatable :: spring_z(:), spring_zd(:)    !! (nz) of springs at the trial state
    real(wp), allocatable :: fp(:, :)        !! (3, places) residual force (body axes) and moment
    real(wp), allocatable :: pairs(:, :)     !! (nq, 4) v, v' means of a step and what the method adds to them
    ! measures
    integer, allocatable :: group(:)         !! (nq) 3 per body: origin, angles, elastic translations, elastic rotations
    real(wp), allocatable :: weight(:)       !! (nq) metres (radians) of a unit
    real(wp), allocatable :: scale(:)        !! (groups) running maxima [m, rad]
    real(wp), allocatable :: unit(:)         !! (nq) weight over scale
    real(wp), allocatable :: whole(:)        !! (nq) weight over the scene's size or one radian
    logical :: stale = .false.               !! restored: factors are to be made again
    logical :: exact = .false.               !! this step uses the exact block
    ! what the last steps told of Newton's method
    real(wp) :: contraction = 1.0_wp         !! of corrections when it was measured last; 1: unknown [-]
    real(wp) :: measured = 0.0_wp            !! first correction of that step, scaled [-]
    logical :: measured_exact = .false.      !! whether that step used the exact block
    integer :: trusted = 0                   !! steps since then
    ! counts
    integer(ip) :: iterations = 0
    integer(ip) :: constant_factors = 0      !! of constant elastic blocks
    integer(ip) :: exact_factors = 0         !! of exact elastic blocks
    integer(ip) :: steps = 0
  end type implicit_solver

contains

  !> Prepares the work space of a mechanism for one spectral radius.
  subroutine set_up_implicit(self, m, method)
    type(implicit_solver), intent(out) :: self
    type(mechanism_model), intent(in) :: m
    type(alpha_method), intent(in) :: method
    integer :: nq, nz, n
    self%method = method
    nq = m%s%nq
    nz = m%s%nz
    n = m%s%rows
    allocate (self%q(nq), self%v(nq), self%vd(nq), self%a(nq), self%q1(nq), self%v1(nq), &
              self%vd1(nq), self%dq(nq), self%change(nq), self%before_own(nq), self%unit(nq), &
              self%weight(nq), source=0.0_wp)
    allocate (self%z(nz), self%zd(nz), self%zdd(nz), self%az(nz), self%pre(nz), self%zk(nz), self%spring_z(nz), &
              self%spring_zd(nz), self%lambda(n), self%lambda1(n), source=0.0_wp)
    allocate (self%before(nq + nz), self%acceleration(nq + nz), self%acceleration1(nq + nz), source=0.0_wp)
    allocate (self%old(nz, 4), self%pairs(nq, 4), source=0.0_wp)
    allocate (self%fp(3, size(m%s%places)), source=0.0_wp)
    call list_terms(self, m)
    call list_rows(self%rows, m)
    call order_rows(self%rows)
    allocate (self%b(size(m%s%bodies)))
    do n = 1, size(self%b)
      if (m%s%bodies(n)%flexible) call set_up_body(self, m, n)
    end do
    call set_up_measures(self, m)
  end subroutine set_up_implicit

  !> All GHM terms, in the order of the dissipative coordinates.
  subroutine list_terms(self, m)
    type(implicit_solver), intent(inout) :: self
    type(mechanism_model), intent(in) :: m
    type(ghm_term) :: t
    type(ghm_term), allocatable :: all(:)
    integer :: b, r, k, n
    allocate (all(m%s%nz))
    n = 0
    do b = 1, size(m%s%bodies)
      do r = 1, size(m%s%bodies(b)%runs)
        associate (run => m%s%bodies(b)%runs(r))
          do k = 1, size(run%alpha)
            t = ghm_term(o=m%s%zo(b) + run%offset + (k - 1)*run%width, n=run%width, body=b, run=r, alpha=run%alpha(k), &
                         two_zw=2*run%zeta(k)*run%omega(k), w2=run%omega(k)**2)
            n = n + 1
            all(n) = t
          end do
        end associate
      end do
    end do
    do b = 1, size(m%s%springs)
      associate (sp => m%s%springs(b))
        do k = 1, size(sp%alpha)
          t = ghm_term(o=sp%offset + k - 1, n=1, spring=b, alpha=sp%alpha(k), two_zw=2*sp%zeta(k)*sp%omega(k), &
                       w2=sp%omega(k)**2)
          n = n + 1
          all(n) = t
        end do
      end associate
    end do
    self%terms = all(1:n)
  end subroutine list_terms

  !> Columns of the places where rows act on a flexible body, and its block.
  subroutine set_up_body(self, m, b)
    type(implicit_solver), intent(inout) :: self
    type(mechanism_model), intent(in) :: m
    integer, intent(in) :: b
    integer, allocatable :: local(:)
    logical, allocatable :: wanted(:, :)
    integer :: k, c, e, nc, n
    allocate (local(size(m%s%places)), source=0)
    allocate (wanted(3, size(m%s%places)), source=.false.)
    associate (t => self%b(b), bo => m%s%bodies(b), r => self%rows)
      t%nf = bo%nf
      do e = r%first(b), r%first(b + 1) - 1
        k = r%place(e)
        if (local(k) == 0) then
          t%na = t%na + 1
          local(k) = t%na
        end if
        r%local(e) = local(k)
        wanted(:, k) = wanted(:, k) .or. r%acts(:, e)
      end do
      allocate (t%place(t%na), t%column(3, t%na), t%seat(2, 3*t%na), source=0)
      nc = 0
      do k = 1, size(local)
        if (local(k) == 0) cycle
        t%place(local(k)) = k
        do c = 1, 3
          if (.not. wanted(c, k)) cycle
          if (.not. bo%modal .and. m%s%places(k)%dof(c) == 0) cycle
          if (bo%modal .and. .not. allocated(m%s%places(k)%psi)) cycle
          nc = nc + 1
          t%column(c, local(k)) = nc
          t%seat(:, nc) = [local(k), c]
        end do
      end do
      t%seat = t%seat(:, 1:nc)
      allocate (t%x(0:bo%nf), t%ff(0:bo%nf), t%col(0:bo%nf), t%row(0:bo%nf), t%xs(bo%nf, 2), t%xe(bo%nf, nc), &
                t%many(bo%nf, 2 + nc), t%compliance(3, 3, t%na, t%na), t%exs(3, 2, t%na), t%exy(3, t%na), &
                t%exf(3, t%na), t%sxe(2, nc), t%rxe(nc), t%load(nc), source=0.0_wp)
      allocate (t%pivots(bo%nf), t%base_pivots(bo%nf), source=0)
      if (bo%modal) then
        allocate (t%dense(bo%nf, bo%nf), t%stiff(bo%nf, bo%nf), t%lu(bo%nf, bo%nf), t%hm(bo%nf), source=0.0_wp)
      else
        call set_up_elements(t%el, bo)
        n = 21*bo%ne + 3*size(bo%lumps)
        allocate (t%rows(n), t%cols(n), t%reordered(bo%nf), source=0)
        allocate (t%values(n), source=0.0_wp)
        call order_exact(t, m, b)
      end if
    end associate
  end subroutine set_up_body

  !> Ordering and room of the exact block of a nodal body.
  subroutine order_exact(t, m, b)
    type(implicit_body), intent(inout) :: t
    type(mechanism_model), intent(in) :: m
    integer, intent(in) :: b
    integer, allocatable :: rows(:), cols(:), order(:), starts(:)
    integer :: e, i, j, n
    associate (bo => m%s%bodies(b))
      allocate (rows(15*bo%ne), cols(15*bo%ne), t%position(bo%nf))
      n = 0
      do e = 1, bo%ne
        do i = 2, 6
          do j = 1, i - 1
            if (bo%edof(i, e) == 0 .or. bo%edof(j, e) == 0) cycle
            n = n + 1
            rows(n) = bo%edof(i, e)
            cols(n) = bo%edof(j, e)
          end do
        end do
      end do
      call reverse_cuthill_mckee(bo%nf, rows(1:n), cols(1:n), order, starts)
      t%position(order) = [(i, i=1, bo%nf)]
      t%kb = maxval(abs(t%position(rows(1:n)) - t%position(cols(1:n))))
      allocate (t%lu(3*t%kb + 1, bo%nf), source=0.0_wp)
    end associate
  end subroutine order_exact

  !> Groups in which Newton's corrections are measured: origin, angle, elastic translations and rotations of every body.
  subroutine set_up_measures(self, m)
    type(implicit_solver), intent(inout) :: self
    type(mechanism_model), intent(in) :: m
    integer :: b, i, k, c
    allocate (self%group(m%s%nq), source=1)
    allocate (self%scale(4*size(m%s%bodies)), source=0.0_wp)
    self%weight = 1.0_wp
    do b = 1, size(m%s%bodies)
      associate (bo => m%s%bodies(b))
        i = m%s%qo(b)
        self%group(i + 1:i + 2) = 4*b - 3
        self%group(i + 3) = 4*b - 2
        self%group(i + 4:i + 3 + bo%nf) = 4*b - 1
        if (bo%modal) then
          do k = 1, bo%nf
            self%weight(i + 3 + k) = maxval(abs(bo%psi([(c, c=1, 3*bo%nn)], k)))
          end do
        else if (bo%flexible) then
          do k = 1, bo%nn
            if (bo%dof(3, k) > 0) self%group(i + 3 + bo%dof(3, k)) = 4*b
          end do
        end if
        self%scale(4*b - 3) = m%s%size
        self%scale(4*b - 2) = 1.0_wp
        self%scale(4*b - 1) = 1.0e-6_wp*m%s%size
        self%scale(4*b) = 1.0e-6_wp
      end associate
    end do
    self%whole = self%weight/m%s%size
    where (mod(self%group, 2) == 0) self%whole = self%weight
  end subroutine set_up_measures
end module implicit_model
