!> Whether damping in proportion to mass damps a body as the reference of its frame lets it. C acts on the motion against the frame
!> (theory.md, section 3). The modes of the body as its joints hold it would lose alpha/(2 omega) if it acted on the whole motion.
!> Bodies that welds join are one here. What other bodies joints hold them to, rests.
module mass_damping
  use kinds, only: half_digits, wp, pi
  use body, only: body_model
  use element_law, only: inertia_of
  use elastic_operators, only: mass_product
  use lapack, only: dgeqp3, dgesdd, dorgqr, dsygvd
  use layered_element, only: element_inertia
  use linear_state, only: evaluate_state
  use linearisation, only: joint_rows_matrix
  use modal_basis, only: modal_model
  use modal_reduction, only: reduce_to_modes
  use scene_run, only: run_state
  use summary_text, only: summary_record
  use text, only: either, to_text
  use triplets, only: triplet_matrix
  implicit none (type, external)
  private
  public :: warn_of_mass_damping

  real(wp), parameter :: told = 0.1_wp               !! difference of a damping ratio [-]
  integer, parameter :: kept = 8                     !! modes of a body, besides its static shapes
  integer, parameter :: compared = 3                 !! modes as the joints hold them
  integer, parameter :: most_nodes = 6               !! of the nodes at which joints hold a body, that make references

  !> A way to fix the frame to the nodes: to one node, to two, or to none (mean axes).
  type :: reference_choice
    integer :: node = 0                              !! its u and v, and its rotation if there is no second
    integer :: second = 0                            !! its v
  end type reference_choice

  !> A body of a group by few modes and static shapes.
  type :: group_member
    integer :: number = 0                            !! of the body
    integer :: before = 0                            !! unknowns of the group before it
    type(body_model) :: b
    real(wp), allocatable :: rows(:, :)              !! (rows, 3 + nf) of joints, by its unknowns [-], [m]
    integer, allocatable :: held(:)                  !! nodes at which joints act
  end type group_member

contains

  !> One warning for each group of bodies that is damped otherwise by more than a tenth.
  subroutine warn_of_mass_damping(run, text)
    type(run_state), intent(inout) :: run
    type(summary_record), intent(inout) :: text
    type(group_member), allocatable :: members(:)
    type(triplet_matrix) :: joints
    integer :: group(size(run%sys%m%s%bodies)), b, k
    logical :: ok
    associate (bodies => run%sys%m%s%bodies)
      if (.not. any([(damped_by_mass(bodies(b)), b=1, size(bodies))])) return
      call evaluate_state(run%sys, run%sys%options, run%y)
      call joint_rows_matrix(run%sys%m, run%sys%ev, joints)
      group = welded_groups(run)
      do b = 1, size(bodies)
        if (group(b) /= b) cycle
        if (.not. any([(group(k) == b .and. damped_by_mass(bodies(k)), k=1, size(bodies))])) cycle
        call gather(run, pack([(k, k=1, size(bodies))], group == b), joints, members, ok)
        if (ok) call judge(run, members, text)
      end do
    end associate
  end subroutine warn_of_mass_damping

  !> Whether a material of the body damps in proportion to mass.
  pure logical function damped_by_mass(b) result(yes)
    type(body_model), intent(in) :: b
    integer :: k
    yes = .false.
    if (.not. b%flexible) return
    do k = 1, size(b%layers%sections)
      yes = yes .or. any(b%layers%sections(k)%layers%ray_m > 0.0_wp)
    end do
  end function damped_by_mass

  !> The first body of those that welds join with each flexible one; 0 of rigid ones.
  pure function welded_groups(run) result(group)
    type(run_state), intent(in) :: run
    integer :: group(size(run%sys%m%s%bodies))
    integer :: k, a, b
    group = merge([(k, k=1, size(group))], 0, run%sys%m%s%bodies%flexible)
    do k = 1, size(run%d%joints)
      if (run%d%joints(k)%type /= 'weld') cycle
      a = run%d%joints(k)%a%body
      b = run%d%joints(k)%b%body
      if (a == 0 .or. b == 0) cycle
      if (group(a) == 0 .or. group(b) == 0) cycle
      a = group(a)
      b = group(b)
      where (group == max(a, b)) group = min(a, b)
    end do
  end function welded_groups

  !> Reduces the bodies of a group, with the rows of their joints.
  subroutine gather(run, numbers, joints, members, ok)
    type(run_state), intent(in) :: run
    integer, intent(in) :: numbers(:)                !! of the bodies
    type(triplet_matrix), intent(in) :: joints       !! (rows, nq) [-], [m]
    type(group_member), allocatable, intent(out) :: members(:)
    logical, intent(out) :: ok
    integer, allocatable :: mine(:), active(:)       ! entries of a body; rows that act on the group
    real(wp), allocatable :: rows(:, :)
    logical :: acts(run%sys%m%s%rows)
    logical :: bad
    integer :: k, e, n
    allocate (members(size(numbers)))
    acts = .false.
    do k = 1, merge(size(numbers), 0, joints%count > 0)
      associate (i => run%sys%m%s%qo(numbers(k)), b => run%sys%m%s%bodies(numbers(k)))
        mine = pack([(e, e=1, joints%count)], joints%cols(:joints%count) > i .and. joints%cols(:joints%count) <= i + 3 + b%nf)
        acts(joints%rows(mine)) = .true.
      end associate
    end do
    active = pack([(k, k=1, size(acts))], acts)
    n = 0
    ok = .true.
    do k = 1, size(numbers)
      associate (x => members(k), i => run%sys%m%s%qo(numbers(k)))
        x%number = numbers(k)
        x%before = n
        x%b = run%sys%m%s%bodies(numbers(k))
        allocate (rows(size(acts), 3 + x%b%nf), source=0.0_wp)
        do e = 1, joints%count
          if (joints%cols(e) <= i .or. joints%cols(e) > i + 3 + x%b%nf) cycle
          rows(joints%rows(e), joints%cols(e) - i) = rows(joints%rows(e), joints%cols(e) - i) + joints%values(e)
        end do
        rows = rows(active, :)
        x%held = held_nodes(run, numbers(k))
        if (x%b%basis%reduced_from == 0) then
          deallocate (x%b%basis)
          call reduce_to_modes(x%b, min(kept, x%b%nf), .true., pack([(e, e=1, x%b%nf)], &
                                                                    any(abs(rows(:, 4:)) > 0.0_wp, 1)), bad)
          ok = ok .and. .not. bad
          if (bad) return
          select type (basis => x%b%basis)
          type is (modal_model)
            rows = reshape([rows(:, :3), matmul(rows(:, 4:), basis%psi(1:, :))], [size(active), 3 + x%b%nf])
          end select
        end if
        call move_alloc(rows, x%rows)
        n = n + 3 + x%b%nf
      end associate
    end do
  end subroutine gather

  !> Nodes of a body at which joints act.
  pure function held_nodes(run, number) result(nodes)
    type(run_state), intent(in) :: run
    integer, intent(in) :: number                    !! of the body
    integer, allocatable :: nodes(:)
    integer :: k
    associate (j => run%d%joints)
      nodes = [pack(j%a%node, j%a%body == number .and. j%a%node > 0), pack(j%b%node, j%b%body == number .and. j%b%node > 0)]
    end associate
    nodes = [1, run%sys%m%s%bodies(number)%nn, nodes]
    nodes = pack(nodes, [(.not. any(nodes(:k - 1) == nodes(k)), k=1, size(nodes))])
    nodes = nodes(:min(size(nodes), most_nodes))
  end function held_nodes

  !> Compares the modes of a group with what their damping would be if it acted on all of their motion, for each reference.
  subroutine judge(run, members, text)
    type(run_state), intent(in) :: run
    type(group_member), intent(in) :: members(:)
    type(summary_record), intent(inout) :: text
    type(reference_choice), allocatable :: choices(:)
    real(wp), allocatable :: omega2(:), x(:, :)
    real(wp), allocatable :: loss(:, :)              ! (modes, whole motion, present reference, choices) [1/s]
    real(wp) :: off                                  ! largest difference of a choice [-]
    integer :: k, c, best, first, modes              ! first: mode that differs
    call held_modes(members, omega2, x)
    modes = min(compared, size(omega2))
    if (modes == 0) return
    choices = possible_references(members)
    allocate (loss(modes, size(choices) + 2), source=0.0_wp)
    do k = 1, size(members)
      call add_losses(members(k), choices, x(members(k)%before + 1:members(k)%before + 3 + members(k)%b%nf, :modes), loss)
    end do
    first = findloc(abs(loss(:, 2)/loss(:, 1) - 1) > told, .true., 1)
    if (first == 0) return
    off = huge(1.0_wp)
    best = 0
    do c = 1, size(choices)
      associate (differs => maxval(abs(loss(:, 2 + c)/loss(:, 1) - 1)))
        if (.not. differs < off - half_digits) cycle
        off = differs
        best = c
      end associate
    end do
    associate (omega => sqrt(omega2(first)))
      call text%warn(named(members)//' has rayleigh_mass, which damps its motion against its frame alone: as its joints hold '// &
                     'it, its mode of '//to_text(omega/(2*pi))//' Hz has the damping ratio '//to_text(loss(first, 2)/(2*omega))// &
                     ' of it, alpha/(2 omega) is '//to_text(loss(first, 1)/(2*omega))//'; '// &
                     advice(run, members, choices(best), off, to_text(loss(first, 2 + best)/(2*omega))))
    end associate
  end subroutine judge

  !> What to do.
  function advice(run, members, choice, off, ratio) result(words)
    type(run_state), intent(in) :: run
    type(group_member), intent(in) :: members(:)
    type(reference_choice), intent(in) :: choice     !! the best
    real(wp), intent(in) :: off                      !! how far it differs [-]
    character(*), intent(in) :: ratio                !! damping ratio with it
    character(:), allocatable :: words, node
    associate (b => run%sys%m%s%bodies(members(1)%number))
      if (choice%node == 0) then
        words = 'reference=''free'''//either(' (with modes)', '', b%basis%reduced_from == 0)
      else if (choice%node == 1 .and. choice%second == 0) then
        words = 'reference=''clamped'''
      else if (choice%node == 1 .and. choice%second == b%nn) then
        words = 'reference=''pinned'''
      else
        node = to_text(choice%node)
        words = 'reference_node='//node//','//node//','//to_text(merge(choice%second, choice%node, choice%second > 0))// &
                ' reference_dof=''u'',''v'','''//either('v', 'r', choice%second > 0)//''''
      end if
    end associate
    if (off <= told) then
      words = words//' has '//ratio
    else
      words = 'no reference agrees (the nearest, '//words//', has '//ratio//'): its frame moves with it'// &
              either('; one body in place of welded ones has less of that', '', size(members) > 1)
    end if
  end function advice

  !> Names of the bodies of a group.
  function named(members) result(words)
    type(group_member), intent(in) :: members(:)
    character(:), allocatable :: words
    words = 'body "'//trim(members(1)%b%name)//'"'
    if (size(members) > 1) words = words//' (welded to '//to_text(size(members) - 1)//' more)'
  end function named

  !> References between which to choose: of one body by the nodes at which it is held, of several by the words of the deck.
  pure function possible_references(members) result(choices)
    type(group_member), intent(in) :: members(:)
    type(reference_choice), allocatable :: choices(:)
    integer :: i, j
    associate (b => members(1)%b, nodes => members(1)%held)
      if (size(members) > 1) then
        choices = [reference_choice(1, 0), reference_choice(1, -1), reference_choice(0, 0)]
        return
      end if
      choices = [reference_choice(1, 0), reference_choice(1, b%nn), reference_choice(0, 0)]
      do i = 1, size(nodes)
        if (nodes(i) /= 1) choices = [choices, reference_choice(nodes(i), 0)]
        do j = 1, size(nodes)
          if (j == i .or. (nodes(i) == 1 .and. nodes(j) == b%nn)) cycle
          if (abs(b%x(1, nodes(j)) - b%x(1, nodes(i))) > half_digits*b%length) choices = [choices, &
                                                                                   reference_choice(nodes(i), nodes(j))]
        end do
      end do
    end associate
  end function possible_references

  !> Adds a body's part of x^T C x: C on the whole motion, against its present frame, and against the frame of each choice.
  subroutine add_losses(x, choices, shapes, loss)
    type(group_member), intent(in) :: x
    type(reference_choice), intent(in) :: choices(:)
    real(wp), intent(in) :: shapes(:, :)             !! (3 + nf, modes) frame and elastic coordinates [m, rad, over kg^.5 m]
    real(wp), intent(inout) :: loss(:, :)            !! (modes, 2 + choices) [1/s]
    type(element_inertia) :: inertia
    real(wp) :: frame(3, 2 + size(choices), size(shapes, 2))   ! rigid motion that is taken away [m, m, rad]
    real(wp), dimension(size(x%b%edof, 1)) :: a, rest   ! coordinates of an element [m, rad]
    real(wp) :: mean(3, 3)                           ! of rigid motions [kg, kg m, kg m2]
    integer :: k, c, e
    mean = rigid_mass(x%b)
    do k = 1, size(shapes, 2)
      frame(:, 1, k) = 0.0_wp
      frame(:, 2, k) = shapes(:3, k)
      do c = 1, size(choices)
        frame(:, 2 + c, k) = shapes(:3, k) + moved_frame(x%b, choices(c), shapes(4:, k), mean)
      end do
    end do
    do e = 1, x%b%ne
      inertia = inertia_of(x%b, e)
      do k = 1, size(shapes, 2)
        a = x%b%basis%element_coordinates(x%b, e, shapes(4:, k))
        call add_rigid(x%b, e, shapes(:3, k), a)
        do c = 1, size(loss, 2)
          rest = a
          call add_rigid(x%b, e, -frame(:, c, k), rest)
          loss(k, c) = loss(k, c) + dot_product(rest, matmul(inertia%c, rest))
        end do
      end do
    end do
  end subroutine add_losses

  !> Adds a rigid motion to the coordinates of an element's ends.
  pure subroutine add_rigid(b, e, motion, a)
    type(body_model), intent(in) :: b
    integer, intent(in) :: e                         !! element
    real(wp), intent(in) :: motion(3)                !! [m, m, rad]
    real(wp), intent(inout) :: a(:)                  !! body axes [m, rad]
    integer :: k
    do k = 1, 2
      associate (x => b%x(:, b%en(k, e)))
        a(3*k - 2:3*k) = a(3*k - 2:3*k) + [motion(1) - motion(3)*x(2), motion(2) + motion(3)*x(1), motion(3)]
      end associate
    end do
  end subroutine add_rigid

  !> The rigid part of an elastic motion that another frame would follow.
  pure function moved_frame(b, choice, q, mean) result(motion)
    type(body_model), intent(in) :: b
    type(reference_choice), intent(in) :: choice
    real(wp), intent(in) :: q(:)                     !! (nf) [m, rad, over kg^.5 m]
    real(wp), intent(in) :: mean(3, 3)               !! mass of rigid motions [kg, kg m, kg m2]
    real(wp) :: motion(3)                            !! [m, m, rad]
    real(wp) :: u(3), v(3), x(2)
    integer :: last
    if (choice%node == 0) then                       ! the momentum of the rest is zero
      motion = solved(mean, [matmul(q, b%shape%sbar), dot_product(q, b%shape%c0)])
      return
    end if
    u = b%displacement(choice%node, q)
    x = b%x(:, choice%node)
    if (choice%second /= 0) then
      last = merge(choice%second, b%nn, choice%second > 0)
      v = b%displacement(last, q)
      u(3) = (v(2) - u(2))/(b%x(1, last) - x(1))
    end if
    motion = [u(1) + u(3)*x(2), u(2) - u(3)*x(1), u(3)]
  end function moved_frame

  !> Mass of the frame's unknowns.
  pure function rigid_mass(b) result(m)
    type(body_model), intent(in) :: b
    real(wp) :: m(3, 3)                              !! [kg, kg m, kg m2]
    m = reshape([b%mass, 0.0_wp, -b%i1(2), 0.0_wp, b%mass, b%i1(1), -b%i1(2), b%i1(1), b%i11], [3, 3])
  end function rigid_mass

  !> Solves A x = b of three unknowns by Cramer's rule.
  pure function solved(a, b) result(x)
    real(wp), intent(in) :: a(3, 3), b(3)            !! [kg, kg m, kg m2], [kg m, kg m2]
    real(wp) :: x(3)                                 !! [m, m, rad]
    real(wp) :: c(3, 3)
    integer :: k
    do k = 1, 3
      c = a
      c(:, k) = b
      x(k) = determinant(c)/determinant(a)
    end do
  contains
    !> Of three columns.
    pure real(wp) function determinant(c) result(d)  ! [any]
      real(wp), intent(in) :: c(3, 3)                !! [any]
      d = c(1, 1)*(c(2, 2)*c(3, 3) - c(2, 3)*c(3, 2)) - c(1, 2)*(c(2, 1)*c(3, 3) - c(2, 3)*c(3, 1)) &
          + c(1, 3)*(c(2, 1)*c(3, 2) - c(2, 2)*c(3, 1))
    end function determinant
  end function solved

  !> Modes that bend, of a group on its joints, mass-normalised and ascending; none where the equations have none.
  subroutine held_modes(members, omega2, x)
    type(group_member), intent(in) :: members(:)
    real(wp), allocatable, intent(out) :: omega2(:)  !! [rad2/s2]
    real(wp), allocatable, intent(out) :: x(:, :)    !! (unknowns, modes) [m, rad, over kg^.5 m]
    real(wp), allocatable :: m(:, :), k(:, :), z(:, :), w(:), work(:), rows(:, :), rigid(:, :)
    integer, allocatable :: iwork(:)
    integer :: j, n, free, info
    n = members(size(members))%before + 3 + members(size(members))%b%nf
    allocate (m(n, n), k(n, n), rows(size(members(1)%rows, 1), n), source=0.0_wp)
    allocate (rigid(size(rows, 1), 3*size(members)))
    do j = 1, size(members)
      associate (i => members(j)%before, nf => members(j)%b%nf)
        call fill_matrices(members(j)%b, m(i + 1:i + 3 + nf, i + 1:i + 3 + nf), k(i + 1:i + 3 + nf, i + 1:i + 3 + nf))
        rows(:, i + 1:i + 3 + nf) = members(j)%rows
        rigid(:, 3*j - 2:3*j) = members(j)%rows(:, :3)/spread([1.0_wp, 1.0_wp, members(j)%b%length], 1, size(rows, 1))
      end associate
    end do
    free = size(rigid, 2) - rank_of(rigid)           ! motions of the group as rigid bodies
    call null_space(rows, [(1/sqrt(m(j, j)), j=1, n)], z)
    n = size(z, 2)
    allocate (w(n), work(1 + 6*n + 2*n*n), iwork(3 + 5*n), omega2(0), x(size(z, 1), 0))
    if (n <= free) return
    k = matmul(transpose(z), matmul(k, z))
    m = matmul(transpose(z), matmul(m, z))
    call dsygvd(1, 'V', 'U', n, k, n, m, n, w, work, size(work), iwork, size(iwork), info)
    if (info /= 0) return
    omega2 = w(free + 1:)
    x = matmul(z, k(:, free + 1:))
  end subroutine held_modes

  !> M and K of a body's frame and elastic coordinates, at rest and undeformed.
  pure subroutine fill_matrices(b, m, k)
    type(body_model), intent(in) :: b
    real(wp), intent(out) :: m(:, :)                 !! [kg, kg m, kg m2]
    real(wp), intent(out) :: k(:, :)                 !! [1/s2]
    real(wp) :: unit(b%nf)                           ! [kg^.5 m]
    integer :: j
    m = 0.0_wp
    k = 0.0_wp
    m(:3, :3) = rigid_mass(b)
    m(4:, 1:2) = b%shape%sbar
    m(4:, 3) = b%shape%c0
    m(:3, 4:) = transpose(m(4:, :3))
    do j = 1, b%nf
      unit = 0.0_wp
      unit(j) = 1.0_wp
      call mass_product(b%op, unit, m(4:, 3 + j))
      select type (basis => b%basis)
      type is (modal_model)
        k(3 + j, 3 + j) = basis%omega2(j)
      end select
    end do
  end subroutine fill_matrices

  !> Rank of a small matrix.
  integer function rank_of(a) result(rank)
    real(wp), intent(in) :: a(:, :)                  !! [any]
    real(wp) :: c(size(a, 1), size(a, 2)), s(min(size(a, 1), size(a, 2))), u(1, 1), vt(1, 1)   ! [any]
    real(wp), allocatable :: work(:)
    integer, allocatable :: iwork(:)
    integer :: info
    rank = 0
    if (size(s) == 0) return
    c = a
    allocate (work(10*(size(a, 1) + size(a, 2)) + 100*size(s)), iwork(8*size(s)))
    call dgesdd('N', size(a, 1), size(a, 2), c, size(a, 1), s, u, 1, vt, 1, work, size(work), iwork, info)
    rank = count(s > half_digits*s(1))
  end function rank_of

  !> Motions in units that the rows allow: the last columns of Q in P J^T = Q R.
  subroutine null_space(rows, unit, z)
    real(wp), intent(in) :: rows(:, :)               !! (rows, unknowns) [-], [m]
    real(wp), intent(in) :: unit(:)                  !! (unknowns) of each [1/sqrt(kg), 1/sqrt(kg) m]
    real(wp), allocatable, intent(out) :: z(:, :)    !! (unknowns, motions) [m, rad, over kg^.5 m]
    real(wp), allocatable :: a(:, :), tau(:), work(:)
    integer, allocatable :: pivots(:)
    integer :: n, nr, info, rank, j
    n = size(unit)
    nr = size(rows, 1)
    allocate (a(n, max(n, nr)), source=0.0_wp)
    allocate (tau(n), work(64*max(n, nr) + 64), pivots(nr))
    pivots = 0
    a(:, :nr) = transpose(rows)*spread(unit, 2, nr)
    rank = 0
    if (nr > 0) then
      call dgeqp3(n, nr, a, n, pivots, tau, work, size(work), info)
      rank = count([(abs(a(j, j)) > half_digits*abs(a(1, 1)), j=1, min(n, nr))])
    end if
    call dorgqr(n, n, rank, a, n, tau, work, size(work), info)
    z = a(:, rank + 1:n)*spread(unit, 2, n - rank)
  end subroutine null_space
end module mass_damping
