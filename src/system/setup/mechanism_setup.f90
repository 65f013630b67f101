!> Prepares a mechanism and the room for its evaluations once, before anything moves: compact copies of the models; the sides of
!> constraint rows on moving bodies, by body, with the joint graph by which the multipliers' matrix S is ordered; the markers
!> where constraints act on flexible bodies: what a unit force there does to the elastic coordinates, columns m_ff^-1 E_k^T, and the
!> compliances E_i m_ff^-1 E_j^T between these markers (theory.md, section 7).
module mechanism_setup
  use kinds, only: wp
  use body, only: body_model
  use evaluation_results, only: evaluation
  use force_element, only: by_position
  use marker, only: marker_model
  use mechanism, only: mechanism_model, flexible_attachments, factor_frame
  use multipliers, only: multiplier_system
  use prototypes, only: find_prototypes
  use scene_model, only: scene
  implicit none (type, external)
  private
  public :: set_up_mechanism

contains

  !> Prepares the mechanism of a scene and the room for its evaluations.
  subroutine set_up_mechanism(self, ev, s)
    type(mechanism_model), intent(out) :: self
    type(evaluation), intent(out) :: ev
    type(scene), intent(in) :: s
    type(multiplier_system) :: schur
    self%s = s
    call compact_models(self)
    call compact_markers(self)
    call collect_incidence(self, schur)
    allocate (self%attached(size(s%bodies)))
    call attach_markers(self)
    call find_prototypes(self)
    call set_up_evaluation(self, schur, ev)
  end subroutine set_up_mechanism

  !> Room for the evaluations of a mechanism, whose multipliers' matrix has been ordered; markers on the ground never move.
  subroutine set_up_evaluation(m, schur, ev)
    type(mechanism_model), intent(in) :: m
    type(multiplier_system), intent(in) :: schur     !! ordered by the joint graph
    type(evaluation), intent(out) :: ev
    integer :: nb, n, k
    nb = size(m%s%bodies)
    n = size(m%incidence%row)
    ev%schur = schur
    if (any(m%flexible)) ev%closing = schur
    associate (f => ev%frame)
      allocate (f%angle(nb), source=huge(1.0_wp))
      allocate (f%cos(nb), f%sin(nb), f%l(3, nb), f%dinv(3, nb), f%rhs(3, nb), f%free(3, nb), f%response(3, nb), &
                f%first_moment(2, nb), source=0.0_wp)
    end associate
    allocate (ev%side%w(3, n), ev%side%frame_wrench(3, n), ev%side%g(3, n), ev%side%rigid_wrench(3, n), source=0.0_wp)
    associate (r => ev%rows)
      n = m%s%rows
      allocate (r%na(2, n), r%nb(2, n), r%sa(n), r%sb(n), r%sc(n), r%phi(n), r%phi_t(n), r%acceleration_bias(n), source=0.0_wp)
      if (m%s%rows > m%s%permanent_rows) then
        allocate (r%off(n), source=[(k > m%s%permanent_rows, k=1, n)])
        allocate (r%acceleration(n), r%pressed(n), source=0.0_wp)
        associate (w => ev%slip)
          allocate (w%start(n), w%b(n), w%x(n), w%f(n), w%law(n), w%slope(2, size(m%s%friction)), w%ab(0, 0), source=0.0_wp)
          w%weighed = w%slope
          allocate (w%law_of(n), w%pivots(0), w%column(2, size(m%s%friction)), source=0)
        end associate
      end if
    end associate
    allocate (ev%dissipated_in(nb), source=0.0_wp)
    allocate (ev%elastic(nb), ev%attached(nb), ev%action(size(m%s%forces)), ev%work(2, maxval([0, m%s%bodies%nf])))
    do k = 1, nb
      if (.not. m%flexible(k)) cycle
      call ev%elastic(k)%allocate(m%s%bodies(k))
      ev%factorisations = ev%factorisations + m%s%bodies(k)%basis%factors
      n = size(m%attached(k)%marker)
      allocate (ev%attached(k)%ex(3, n), ev%attached(k)%ey(3, n), ev%attached(k)%load(size(m%attached(k)%columns, 2)), &
                source=0.0_wp)
    end do
    allocate (ev%displacement(3, size(m%s%markers)), source=0.0_wp)
    allocate (ev%wrench(3, size(m%s%markers)), ev%lambda(m%s%rows), ev%lambda_change(m%s%rows), ev%a(m%s%nq), &
              ev%change(m%s%nq), ev%zdd(m%s%nz), source=0.0_wp)
    allocate (ev%control(size(m%s%controllers)), ev%factor(size(m%s%factors)))
    allocate (ev%signals(0:1, size(m%s%forces) - m%s%acting), source=0.0_wp)
    do k = 1, size(ev%factor)
      allocate (ev%factor(k)%slopes(size(m%s%factors(k)%arguments)), source=0.0_wp)
    end do
    allocate (ev%loss(m%s%term_losses), source=0.0_wp)
    allocate (ev%switches%state(m%s%elements), source=by_position)
    allocate (ev%switches%event_value(m%s%elements), source=0.0_wp)
    call ev%p%allocate(size(m%s%markers))
    do k = 1, size(m%s%markers)
      if (m%s%markers(k)%body == 0) ev%p%r(:, k) = m%s%markers(k)%x
      ev%p%rho(:, k) = m%s%markers(k)%x
    end do
  end subroutine set_up_evaluation

  !> Copies what loops over many rigid bodies and markers need, so that they do not touch the models.
  pure subroutine compact_models(self)
    type(mechanism_model), intent(inout) :: self
    integer :: b
    self%flexible = self%s%bodies%flexible
    allocate (self%rigid(9, size(self%flexible)), source=0.0_wp)
    do b = 1, size(self%flexible)
      associate (body => self%s%bodies(b), r => self%rigid(:, b))
        if (body%flexible) cycle
        r(1) = body%mass
        r(2:3) = body%i1
        call factor_frame(body%mass, 0.0_wp, body%mass, -body%i1(2), body%i1(1), body%i11, r(4:6), r(7:9))
      end associate
    end do
  end subroutine compact_models

  !> Sorts the markers on bodies by what their motion follows from, and copies what is needed for that.
  pure subroutine compact_markers(self)
    type(mechanism_model), intent(inout) :: self
    integer, allocatable :: kind(:)             !! of each marker: 0 ground, 1 rigid, 2 nodal, 3 modal
    integer :: k
    self%markers%body = self%s%markers%body
    allocate (kind(size(self%markers%body)), source=0)
    allocate (self%markers%dof(3, size(kind)), self%markers%x(2, size(kind)))
    do k = 1, size(kind)
      self%markers%dof(:, k) = self%s%markers(k)%dof
      self%markers%x(:, k) = self%s%markers(k)%x
      if (self%markers%body(k) == 0) cycle
      kind(k) = 1
      if (self%flexible(self%markers%body(k))) kind(k) = merge(3, 2, allocated(self%s%markers(k)%psi))
    end do
    self%markers%rigid = pack([(k, k=1, size(kind))], kind == 1)
    self%markers%nodal = pack([(k, k=1, size(kind))], kind == 2)
    self%markers%modal = pack([(k, k=1, size(kind))], kind == 3)
  end subroutine compact_markers

  !> Lists the sides of all rows, body by body, orders the joint graph and finds the entries of S.
  subroutine collect_incidence(self, schur)
    type(mechanism_model), intent(inout) :: self
    type(multiplier_system), intent(out) :: schur
    integer, allocatable :: others(:)
    integer :: k, i, row
    associate (at => self%incidence)
      call at%begin(3*self%s%rows)
      call at%add_constraints(self%s)
      call at%sort(size(self%s%bodies))
      allocate (at%row_marker(2, self%s%rows))
      allocate (at%with_carrier(0), at%carrier(0), at%places(0), at%angles(0), others(0), at%datum(self%s%rows))
      do k = 1, size(self%s%constraints)
        associate (c => self%s%constraints(k)%item)
          do i = 1, c%rows
            row = c%first + i - 1
            at%row_marker(:, row) = [c%ia, c%ib]
            at%datum(row) = c%measures(i)%item%datum
            if (.not. c%is_plain(i)) then
              others = [others, k, i]
            else if (c%measures(i)%item%angular) then
              at%angles = [at%angles, row]
            else
              at%places = [at%places, row]
            end if
          end do
          if (c%ic > 0) then
            at%with_carrier = [at%with_carrier, c%first]
            at%carrier = [at%carrier, c%ic]
          end if
        end associate
      end do
      at%others = reshape(others, [2, size(others)/2])
    end associate
    call order_rows(self, schur)
  end subroutine collect_incidence

  !> Orders S by the pairs of rows that meet on a body, and finds the entry of each pair of sides, themselves included.
  subroutine order_rows(self, schur)
    type(mechanism_model), intent(inout) :: self
    type(multiplier_system), intent(inout) :: schur
    integer, allocatable :: rows(:), cols(:)    !! (pairs)
    logical, allocatable :: same(:)             !! (pairs) a side with itself
    integer :: n, b, e, f
    associate (at => self%incidence)
      n = sum([((at%first(b + 1) - at%first(b))*(at%first(b + 1) - at%first(b) + 1)/2, b=1, size(self%s%bodies))])
      allocate (rows(n), cols(n), same(n))
      n = 0
      do b = 1, size(self%s%bodies)
        do e = at%first(b), at%first(b + 1) - 1
          do f = at%first(b), e
            n = n + 1
            rows(n) = at%row(e)
            cols(n) = at%row(f)
            same(n) = e == f
          end do
        end do
      end do
      call schur%set_up(self%s%rows, rows, cols, same)
    end associate
  end subroutine order_rows

  !> Attachments of every flexible body.
  subroutine attach_markers(self)
    type(mechanism_model), intent(inout) :: self
    integer, allocatable :: local(:)
    integer :: b
    allocate (local(size(self%s%markers)), source=0)
    do b = 1, size(self%s%bodies)
      associate (at => self%attached(b), body => self%s%bodies(b))
        if (.not. body%flexible) cycle
        call self%incidence%attach(self%s, b, local, at)
        call fill_columns(self%s%markers, body, at)
        call fill_compliances(self%s%markers, body, at)
      end associate
    end do
  end subroutine attach_markers

  !> The columns m_ff^-1 E_k^T.
  subroutine fill_columns(markers, body, at)
    type(marker_model), intent(in) :: markers(:) !! of the scene
    type(body_model), intent(in) :: body
    type(flexible_attachments), intent(inout) :: at
    real(wp) :: work(2, body%nf)                 ! [any]
    integer :: j
    allocate (at%columns(body%nf, size(at%owner)), source=0.0_wp)
    do j = 1, size(at%owner)
      call markers(at%marker(at%owner(j)))%add_elastic_forces(merge(1.0_wp, 0.0_wp, [1, 2, 3] == at%component(j)), at%columns(:, j))
      call body%basis%solve_mass(body%nf, work, at%columns(:, j))
    end do
  end subroutine fill_columns

  !> Compliances between the markers, and E_k m_ff^-1 S-bar^T.
  pure subroutine fill_compliances(markers, body, at)
    type(marker_model), intent(in) :: markers(:) !! of the scene
    type(body_model), intent(in) :: body
    type(flexible_attachments), intent(inout) :: at
    integer :: n, i, j
    n = size(at%marker)
    allocate (at%compliance(3, 3, n, n), at%ep(3, 2, n), source=0.0_wp)
    do i = 1, n
      associate (marker => markers(at%marker(i)))
        at%ep(:, 1, i) = marker%elastic(body%shape%pmat(:, 1))
        at%ep(:, 2, i) = marker%elastic(body%shape%pmat(:, 2))
        do j = 1, size(at%owner)
          at%compliance(:, at%component(j), i, at%owner(j)) = marker%elastic(at%columns(:, j))
        end do
      end associate
    end do
  end subroutine fill_compliances
end module mechanism_setup
