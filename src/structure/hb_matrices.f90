!> Structure given by its matrices, for instance from another program or from a paper.
module hb_matrices
   use hb_error, only: annotate, error_t, fail
   use hb_kinds, only: wp
   use hb_properties, only: properties_t
   use hb_proportional_damping, only: proportional_damping_t, read_proportional_damping
   use hb_structure, only: check_memory_of_structure, label_length, new_structure, structure_t
   use hb_text, only: string_t, to_text
   implicit none
   private
   public :: read_matrices

   character(26), parameter :: keys(7) = [character(26) :: "mass", "damping", "gyroscopic", "stiffness", &
      "gyroscopic_by_speed", "stiffness_by_speed", "stiffness_by_speed_squared"]

   !> Numbers of one matrix as given in the input.
   type :: values_t
      real(wp), allocatable :: values(:)
   end type values_t

contains

   !> Reads the matrices from the keys of their group `&structure`.
   !>
   !> Each matrix is given row by row with n_dofs**2 numbers, or as the n_dofs numbers of its diagonal. Labels are x1,
   !> x2, ... and units `m` by default.
   subroutine read_matrices(group, structure, error, memory_limit)
      type(properties_t), intent(inout) :: group
      type(structure_t), intent(out) :: structure
      type(error_t), allocatable, intent(out) :: error
      real(wp), intent(in), optional :: memory_limit         !! bytes
      type(proportional_damping_t) :: proportional
      type(string_t), allocatable :: labels(:), units(:)
      real(wp), allocatable :: damping(:, :), stiffness(:, :)
      type(values_t) :: of(size(keys))
      real(wp) :: speed
      integer :: i, n_dofs

      call group%get("n_dofs", n_dofs)
      allocate (labels(max(n_dofs, 0)), units(max(n_dofs, 0)))
      do i = 1, n_dofs
         labels(i)%value = "x"//to_text(i)
      end do
      do i = 1, size(keys)
         allocate (of(i)%values(max(n_dofs, 0)), source=0.0_wp)
      end do
      call group%get("mass", of(1)%values)
      call group%get("damping", of(2)%values)
      call group%get("gyroscopic", of(3)%values)
      call group%get("stiffness", of(4)%values)
      call group%get("gyroscopic_by_speed", of(5)%values)
      call group%get("stiffness_by_speed", of(6)%values)
      call group%get("stiffness_by_speed_squared", of(7)%values)
      do i = 1, merge(size(keys), 0, n_dofs > 0)
         call check_matrix(group, trim(keys(i)), of(i)%values, n_dofs)
      end do
      call group%get("speed", speed, required=any([(group%given(trim(keys(i))), i=5, size(keys))]))
      call group%get("labels", labels)
      call group%get("units", units)
      call read_proportional_damping(group, proportional)
      call group%finish(error)
      if (allocated(error)) return
      call check_memory_of_structure(n_dofs, error, memory_limit)
      if (.not. allocated(error)) call check_skew("gyroscopic", full(of(3)%values, n_dofs), error)
      if (.not. allocated(error)) call check_skew("gyroscopic_by_speed", full(of(5)%values, n_dofs), error)
      if (.not. allocated(error)) then
         stiffness = full(of(4)%values, n_dofs)
         associate (m => full(of(1)%values, n_dofs))
            damping = full(of(2)%values, n_dofs) + full(of(3)%values, n_dofs) + proportional%matrix(m, stiffness)
            if (group%given("gyroscopic_by_speed")) damping = damping + speed*full(of(5)%values, n_dofs)
            if (group%given("stiffness_by_speed")) stiffness = stiffness + speed*full(of(6)%values, n_dofs)
            if (group%given("stiffness_by_speed_squared")) stiffness = stiffness + speed**2*full(of(7)%values, n_dofs)
            call new_structure(structure, m, damping, stiffness, words(labels), words(units), error)
         end associate
      end if
      call annotate(error, group%location())
   end subroutine read_matrices

   subroutine check_skew(name, matrix, error)
      character(*), intent(in) :: name
      real(wp), intent(in) :: matrix(:, :)
      type(error_t), allocatable, intent(out) :: error

      if (maxval(abs(matrix + transpose(matrix))) > 1.0e-10_wp*maxval(abs(matrix))) &
         call fail(error, "matrices: the "//name//" matrix must be skew-symmetric, G(j, i) = -G(i, j); "// &
                   "dissipative terms belong to the damping matrix")
   end subroutine check_skew

   !> Adds a problem unless the number of values is that of a full or a diagonal matrix.
   subroutine check_matrix(group, key, values, n_dofs)
      type(properties_t), intent(inout) :: group
      character(*), intent(in) :: key
      real(wp), intent(in) :: values(:)
      integer, intent(in) :: n_dofs

      if (size(values) == n_dofs .or. size(values) == n_dofs**2) return
      call group%problem(key, "needs "//to_text(n_dofs**2)//" values row by row, or "//to_text(n_dofs)// &
                         " for a diagonal matrix; there are "//to_text(size(values)))
   end subroutine check_matrix

   !> Matrix from its rows, or from its diagonal.
   pure function full(values, n) result(matrix)
      real(wp), intent(in) :: values(:)                      !! n**2 or n of them
      integer, intent(in) :: n
      real(wp) :: matrix(n, n)
      integer :: i

      if (size(values) == n**2) then
         matrix = transpose(reshape(values, [n, n]))
      else
         matrix = 0.0_wp
         do i = 1, n
            matrix(i, i) = values(i)
         end do
      end if
   end function full

   !> Texts of a list in one length, long enough to detect those that are too long.
   pure function words(list)
      type(string_t), intent(in) :: list(:)
      character(label_length + 1) :: words(size(list))
      integer :: i

      do i = 1, size(list)
         words(i) = list(i)%value
      end do
   end function words
end module hb_matrices
