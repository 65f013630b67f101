!> The mechanism: a scene with the work space of its equations of motion, and what is computed once (attachment columns
!> m_ff^-1 E^T and compliances, the joint graph). The equations themselves are in `dynamics`.
module mechanism
  use kinds, only: wp, ip
  use banded, only: band_solve
  use scene_model, only: scene
  use place, only: place_states
  use constraint, only: constraint_rows
  use multipliers, only: multiplier_system
  implicit none (type, external)
  private
  public :: mechanism_model, flexible_attachments, set_up_mechanism, factor_frame

  !> Attached places of a flexible body: columns m_ff^-1 E_k^T and the compliances between them (constant).
  type :: flexible_attachments
    integer, allocatable :: place(:)            !! attached places (indices in the scene's list)
    real(wp), allocatable :: columns(:, :)      !! (nf, nc) m_ff^-1 E^T [1/kg ...]
    integer, allocatable :: column(:, :)        !! (3, na) column of each place's u, v, rotation, 0: none needed
    real(wp), allocatable :: compliance(:, :, :, :)   !! (3, 3, na, na) E_i m_ff^-1 E_j^T
    real(wp), allocatable :: ep(:, :, :)        !! (3, 2, na) E_k m_ff^-1 S-bar^T
    real(wp), allocatable :: ex(:, :)           !! (3, na) E_k m_ff^-1 Q_f, this evaluation
    real(wp), allocatable :: ey(:, :)           !! (3, na) E_k m_ff^-1 m_theta_f^T, this evaluation
    real(wp), allocatable :: load(:)            !! (nc) multiplier forces on the columns
  end type flexible_attachments

  !> Scene and work space.
  type :: mechanism_model
    type(scene) :: s
    type(place_states) :: p                     !! states of the scene's places
    type(constraint_rows) :: rows
    type(multiplier_system) :: schur
    type(flexible_attachments), allocatable :: attached(:)   !! (nb), empty for rigid bodies
    ! what loops over many bodies need, apart from the bulky models
    logical, allocatable :: flexible(:)         !! (nb)
    real(wp), allocatable :: rigid(:, :)        !! (9, nb) rigid bodies: mass [kg], I1 [kg m], L and 1/D of the frame's mass
    integer, allocatable :: place_body(:)       !! (places) body of each place, 0: the ground
    integer, allocatable :: place_dof(:, :)     !! (3, places) elastic coordinates (u, v, rotation) of each place, 0: none
    real(wp), allocatable :: place_x(:, :)      !! (2, places) undeformed positions, body axes [m]
    integer, allocatable :: nodal_places(:)     !! places on flexible bodies in nodal coordinates
    integer, allocatable :: modal_places(:)     !! places on flexible bodies in modal coordinates
    integer, allocatable :: rigid_places(:)     !! places on rigid bodies
    integer, allocatable :: row_place(:, :)     !! (2, rows) places a and b of each row
    ! ends of constraint rows on moving bodies, grouped by body
    integer, allocatable :: end_first(:)        !! (nb+1) first end of each body
    integer, allocatable :: end_row(:)          !! row of each end
    integer, allocatable :: end_place(:)        !! its place
    integer, allocatable :: end_body(:)         !! its body
    integer, allocatable :: end_local(:)        !! its place's number among the body's attachments (flexible bodies)
    logical, allocatable :: end_is_a(:)         !! side of the row
    integer, allocatable :: of_row(:, :)        !! (2, rows) ends of each row, 0: on the ground
    integer, allocatable :: slot(:)             !! entry of S for each pair of ends f <= e of one body, body by body; negative
                                                !! where both are ends of one row, whose entry gets the pair twice
    real(wp), allocatable :: w(:, :)            !! (3, ends) wrench of a unit multiplier, body axes
    real(wp), allocatable :: jw(:, :)           !! (3, ends) the same on the condensed frame, J^T w
    real(wp), allocatable :: g(:, :)            !! (3, ends) L^-1 J^T w
    type(multiplier_system) :: closing          !! Phi_r Mc^-1 Phi_r^T of the frames alone, elastic coordinates held
    real(wp), allocatable :: lever(:, :)        !! (3, ends) wrench of a unit multiplier on the frame, elastic coordinates held
    ! frames
    real(wp), allocatable :: c(:), sn(:)        !! (nb) cosine and sine of the frame angle [-]
    real(wp), allocatable :: low(:, :)          !! (3, nb) L of the condensed 3 x 3 mass: l21, l31, l32
    real(wp), allocatable :: dinv(:, :)         !! (3, nb) 1/D of it
    real(wp), allocatable :: rhs(:, :)          !! (3, nb) condensed generalised forces, body axes
    real(wp), allocatable :: free(:, :)         !! (3, nb) accelerations without multipliers, body axes
    real(wp), allocatable :: push(:, :)         !! (3, nb) what the multipliers take from them
    real(wp), allocatable :: wrench(:, :)       !! (3, places) force in body axes and moment of springs and loads
    real(wp), allocatable :: pin(:, :)          !! (2, nb) p = I1 + S-bar q_f, body axes [kg m]
    ! results of the last evaluation
    real(wp), allocatable :: lambda(:)          !! (rows) multipliers [N]
    real(wp), allocatable :: lambda_change(:)   !! (rows) correction of the multipliers [N]
    real(wp), allocatable :: change(:)          !! (nq) correction of the accelerations
    real(wp), allocatable :: a(:)               !! (nq) accelerations, global axes for the frames' origins
    real(wp), allocatable :: zdd(:)             !! (nz) dissipative accelerations
    real(wp), allocatable :: spring_force(:)    !! (springs) force or moment
    real(wp) :: dissipated_power = 0.0_wp       !! [W]
    real(wp) :: input_power = 0.0_wp            !! of loads and drives [W]
    real(wp) :: t = 0.0_wp                      !! time of the last evaluation [s]
    integer :: stage = 2                        !! stage_static or stage_transient of `load`
    logical :: left = .false.                   !! jumps of histories at t are not yet felt
    logical :: frozen = .false.                 !! assembly: elastic coordinates do not move
    real(wp) :: load_factor = 1.0_wp            !! static analysis: fraction of the loads
    real(wp) :: baumgarte(2) = 0.0_wp           !! alpha, beta [1/s]
    ! counts
    integer(ip) :: evaluations = 0              !! right-hand sides
    integer(ip) :: solves = 0                   !! banded solves of bodies
    integer(ip) :: factorisations = 0           !! of body mass matrices
    logical :: redundant = .false.              !! some rows depend on others everywhere, not only in a singular position
    logical :: broken = .false.                 !! a condensed mass matrix lost positive definiteness
  end type mechanism_model

contains

  !> Prepares the work space of a scene.
  subroutine set_up_mechanism(self, s)
    type(mechanism_model), intent(out) :: self
    type(scene), intent(in) :: s
    integer :: nb
    self%s = s
    nb = size(s%bodies)
    call self%p%allocate(size(s%places))
    call compact_models(self)
    call compact_places(self)
    call fixed_places(self)
    call allocate_rows(self%rows, s%rows)
    call collect_ends(self)
    allocate (self%attached(nb))
    call attach_places(self)
    allocate (self%c(nb), self%sn(nb), self%low(3, nb), self%dinv(3, nb), self%rhs(3, nb), self%free(3, nb), self%push(3, nb), &
              self%pin(2, nb), source=0.0_wp)
    allocate (self%wrench(3, size(s%places)), self%lambda(s%rows), self%lambda_change(s%rows), self%a(s%nq), &
              self%change(s%nq), self%zdd(s%nz), &
              self%spring_force(size(s%springs)), source=0.0_wp)
    self%factorisations = count(s%bodies%flexible .and. .not. s%bodies%modal)
  end subroutine set_up_mechanism

  !> Copies what loops over many rigid bodies and places need, so that they need not touch the models.
  pure subroutine compact_models(self)
    type(mechanism_model), intent(inout) :: self
    integer :: b
    self%flexible = self%s%bodies%flexible
    allocate (self%rigid(9, size(self%flexible)), source=0.0_wp)
    do b = 1, size(self%flexible)
      associate (bo => self%s%bodies(b), r => self%rigid(:, b))
        if (bo%flexible) cycle
        r(1) = bo%mass
        r(2:3) = bo%i1
        call factor_frame(bo%mass, 0.0_wp, bo%mass, -bo%i1(2), bo%i1(1), bo%i11, r(4:6), r(7:9))
      end associate
    end do
  end subroutine compact_models

  !> Sorts the places on bodies by what their motion follows from, and copies what is needed for that.
  pure subroutine compact_places(self)
    type(mechanism_model), intent(inout) :: self
    integer, allocatable :: kind(:)             !! of each place: 0 ground, 1 rigid, 2 nodal, 3 modal
    integer :: k
    self%place_body = self%s%places%body
    allocate (kind(size(self%place_body)), source=0)
    allocate (self%place_dof(3, size(kind)), self%place_x(2, size(kind)))
    do k = 1, size(kind)
      self%place_dof(:, k) = self%s%places(k)%dof
      self%place_x(:, k) = self%s%places(k)%x
      if (self%place_body(k) == 0) cycle
      kind(k) = 1
      if (self%flexible(self%place_body(k))) kind(k) = merge(3, 2, allocated(self%s%places(k)%psi))
    end do
    self%rigid_places = pack([(k, k=1, size(kind))], kind == 1)
    self%nodal_places = pack([(k, k=1, size(kind))], kind == 2)
    self%modal_places = pack([(k, k=1, size(kind))], kind == 3)
  end subroutine compact_places

  !> L D L^T of the condensed 3 x 3 mass matrix [[a, b, d], [b, c, e], [d, e, f]].
  pure subroutine factor_frame(a, b, c, d, e, f, low, dinv)
    real(wp), intent(in) :: a, b, c, d, e, f
    real(wp), intent(out) :: low(3), dinv(3)   !! l21, l31, l32 and 1/D
    real(wp) :: d2
    dinv(1) = 1.0_wp/a
    low(1) = b*dinv(1)
    low(2) = d*dinv(1)
    d2 = c - low(1)*b
    dinv(2) = 1.0_wp/d2
    low(3) = (e - low(2)*b)*dinv(2)
    dinv(3) = 1.0_wp/(f - low(2)*d - low(3)**2*d2)
  end subroutine factor_frame

  !> Places on the ground never move.
  pure subroutine fixed_places(self)
    type(mechanism_model), intent(inout) :: self
    integer :: k
    do k = 1, size(self%s%places)
      if (self%s%places(k)%body == 0) self%p%r(:, k) = self%s%places(k)%x
      self%p%rho(:, k) = self%s%places(k)%x
    end do
  end subroutine fixed_places

  !> Arrays of constraint rows.
  pure subroutine allocate_rows(r, n)
    type(constraint_rows), intent(inout) :: r
    integer, intent(in) :: n
    allocate (r%na(2, n), r%nb(2, n), r%sa(n), r%sb(n), r%phi(n), r%phi_t(n), r%extra(n), source=0.0_wp)
  end subroutine allocate_rows

  !> Lists the ends of rows on moving bodies, body by body, and orders the joint graph.
  subroutine collect_ends(self)
    type(mechanism_model), intent(inout) :: self
    integer, allocatable :: fill(:), rows(:), cols(:)
    integer :: nb, k, i, side, body, place, e, f, n
    nb = size(self%s%bodies)
    allocate (self%end_first(nb + 1), fill(nb), self%of_row(2, self%s%rows), self%row_place(2, self%s%rows))
    self%of_row = 0
    self%end_first = 0
    do k = 1, size(self%s%constraints)
      associate (c => self%s%constraints(k)%item)
        do side = 1, 2
          body = self%s%places(merge(c%ia, c%ib, side == 1))%body
          if (body > 0) self%end_first(body + 1) = self%end_first(body + 1) + c%rows
        end do
      end associate
    end do
    self%end_first(1) = 1
    do k = 1, nb
      self%end_first(k + 1) = self%end_first(k + 1) + self%end_first(k)
    end do
    n = self%end_first(nb + 1) - 1
    allocate (self%end_row(n), self%end_place(n), self%end_body(n), self%end_local(n), self%end_is_a(n))
    allocate (self%w(3, n), self%jw(3, n), self%g(3, n), self%lever(3, n), source=0.0_wp)
    self%end_local = 0
    fill = self%end_first(1:nb)
    do k = 1, size(self%s%constraints)
      associate (c => self%s%constraints(k)%item)
        do i = c%first, c%first + c%rows - 1
          self%row_place(:, i) = [c%ia, c%ib]
          do side = 1, 2
            place = merge(c%ia, c%ib, side == 1)
            body = self%s%places(place)%body
            if (body == 0) cycle
            e = fill(body)
            fill(body) = e + 1
            self%end_row(e) = i
            self%end_place(e) = place
            self%end_body(e) = body
            self%end_is_a(e) = side == 1
            self%of_row(side, i) = e
          end do
        end do
      end associate
    end do
    n = 0
    do body = 1, nb
      n = n + (self%end_first(body + 1) - self%end_first(body))**2/2
    end do
    allocate (rows(n), cols(n))
    n = 0
    do body = 1, nb
      do e = self%end_first(body), self%end_first(body + 1) - 1
        do f = self%end_first(body), e - 1
          n = n + 1
          rows(n) = self%end_row(e)
          cols(n) = self%end_row(f)
        end do
      end do
    end do
    call self%schur%set_up(self%s%rows, rows(1:n), cols(1:n))
    if (any(self%flexible)) self%closing = self%schur
    call find_slots(self)
  end subroutine collect_ends

  !> Entries of S for all pairs of ends.
  pure subroutine find_slots(self)
    type(mechanism_model), intent(inout) :: self
    integer :: n, b, e, f, i, j
    n = 0
    do b = 1, size(self%s%bodies)
      i = self%end_first(b + 1) - self%end_first(b)
      n = n + i*(i + 1)/2
    end do
    allocate (self%slot(n))
    n = 0
    do b = 1, size(self%s%bodies)
      do e = self%end_first(b), self%end_first(b + 1) - 1
        i = self%schur%position(self%end_row(e))
        do f = self%end_first(b), e
          n = n + 1
          j = self%schur%position(self%end_row(f))
          self%slot(n) = 1 + abs(i - j) + (self%schur%kd + 1)*(min(i, j) - 1)
          if (i == j .and. f < e) self%slot(n) = -self%slot(n)
        end do
      end do
    end do
  end subroutine find_slots

  !> Columns and compliances of the places where constraints act on flexible bodies.
  subroutine attach_places(self)
    type(mechanism_model), intent(inout) :: self
    logical, allocatable :: positions(:), angles(:)
    integer, allocatable :: local(:)
    integer :: k, b
    allocate (local(size(self%s%places)), source=0)
    allocate (positions(size(self%s%places)), angles(size(self%s%places)), source=.false.)
    do k = 1, size(self%s%constraints)
      associate (c => self%s%constraints(k)%item)
        if (c%moves()) positions([c%ia, c%ib]) = .true.
        if (c%turns_a()) angles(c%ia) = .true.
        if (c%turns_b()) angles(c%ib) = .true.
      end associate
    end do
    do b = 1, size(self%s%bodies)
      if (self%s%bodies(b)%flexible) call attach_body(self, b, positions, angles, local)
    end do
  end subroutine attach_places

  !> The same for one flexible body.
  subroutine attach_body(self, b, positions, angles, local)
    type(mechanism_model), intent(inout) :: self
    integer, intent(in) :: b
    logical, intent(in) :: positions(:), angles(:)   !! whether constraints act on a place's position, its angle
    integer, intent(inout) :: local(:)               !! work space: zero on the places of this body
    integer :: k, n, nc, e, c, i, j
    associate (t => self%attached(b), bo => self%s%bodies(b))
      n = 0
      do e = self%end_first(b), self%end_first(b + 1) - 1
        k = self%end_place(e)
        if (local(k) == 0) then
          n = n + 1
          local(k) = n
        end if
        self%end_local(e) = local(k)
      end do
      allocate (t%place(n), t%column(3, n), t%compliance(3, 3, n, n), t%ep(3, 2, n), t%ex(3, n), t%ey(3, n))
      t%column = 0
      t%ex = 0.0_wp
      t%ey = 0.0_wp
      do e = self%end_first(b), self%end_first(b + 1) - 1
        t%place(self%end_local(e)) = self%end_place(e)
      end do
      nc = 0
      do i = 1, n
        k = t%place(i)
        do c = 1, 3
          if (bo%modal) then
            if (.not. allocated(self%s%places(k)%psi)) cycle
          else
            if (self%s%places(k)%dof(c) == 0) cycle
          end if
          if (c < 3 .and. .not. positions(k)) cycle
          if (c == 3 .and. .not. angles(k)) cycle
          nc = nc + 1
          t%column(c, i) = nc
        end do
      end do
      allocate (t%columns(bo%nf, nc), t%load(nc), source=0.0_wp)
      do i = 1, n
        do c = 1, 3
          if (t%column(c, i) == 0) cycle
          associate (x => t%columns(:, t%column(c, i)), place => self%s%places(t%place(i)))
            if (bo%modal) then
              x = place%psi(c, :)
            else
              x(place%dof(c)) = 1.0_wp
              call band_solve(bo%mff, x)
            end if
          end associate
        end do
      end do
      do i = 1, n
        t%ep(:, 1, i) = self%s%places(t%place(i))%elastic(bo%pmat(:, 1))
        t%ep(:, 2, i) = self%s%places(t%place(i))%elastic(bo%pmat(:, 2))
        do j = 1, n
          t%compliance(:, :, i, j) = 0.0_wp
          do c = 1, 3
            if (t%column(c, j) > 0) t%compliance(:, c, i, j) = self%s%places(t%place(i))%elastic(t%columns(:, t%column(c, j)))
          end do
        end do
      end do
    end associate
  end subroutine attach_body
end module mechanism
